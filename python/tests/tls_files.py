"""Certificate of a server on this machine, and the authority that issued it."""

import trustme


def create_tls_files(folder):
    """Writes `ca.pem`, `cert.pem` and `key.pem` for 127.0.0.1 into a folder, and returns it."""
    authority = trustme.CA()
    authority.cert_pem.write_to_path(folder / "ca.pem")
    certificate = authority.issue_cert("127.0.0.1")
    certificate.cert_chain_pems[0].write_to_path(folder / "cert.pem")
    certificate.private_key_pem.write_to_path(folder / "key.pem")
    return folder
