//! NATS server with TLS and one key for each role, by the configuration that deployments use.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use nkeys::KeyPair;
use system_tests::TlsFiles;
use system_tests::nats_server::NatsServer;

/// Configuration of a NATS server with keys.
const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../deploy/nats.conf");

/// NATS server with TLS, and files with the seeds of the keys of its users.
pub(crate) struct SecureNats {
    server: NatsServer,
    tls: TlsFiles,
    folder: tempfile::TempDir,
}

impl SecureNats {
    pub(crate) fn start() -> Option<Self> {
        let (tls, folder) = (TlsFiles::create(), tempfile::tempdir().unwrap());
        let path = |name: &str| tls.path(name).display().to_string();
        let mut variables =
            vec![("NATS_CERT".to_owned(), path("cert.pem")), ("NATS_KEY".to_owned(), path("key.pem"))];
        for user in ["SERVER", "REPLAY_WORKER", "DESIGN_WORKER", "WORKER", "TRAINER"] {
            let key = KeyPair::new_user();
            std::fs::write(folder.path().join(user), key.seed().unwrap()).unwrap();
            variables.push((format!("{user}_KEY"), key.public_key()));
        }
        let server = NatsServer::start_with(Some(PathBuf::from(CONFIG)), variables)?;
        Some(Self { server, tls, folder })
    }

    fn seed_file(&self, user: &str) -> PathBuf {
        self.folder.path().join(user)
    }

    /// Options of `sparring` for a user.
    pub(crate) fn options(&self, user: &str) -> Vec<String> {
        let text = |path: &Path| path.display().to_string();
        let (ca, seed) = (text(&self.tls.path("ca.pem")), text(&self.seed_file(user)));
        ["--nats", &self.server.tls_url(), "--nats-ca", &ca, "--nats-creds", &seed]
            .map(str::to_owned)
            .to_vec()
    }

    /// Connects as a user, with the replies that its role may read. Errors that the server reports are added to `errors`.
    pub(crate) async fn connect(&self, user: &str, errors: &Arc<Mutex<Vec<String>>>) -> async_nats::Client {
        let seed = std::fs::read_to_string(self.seed_file(user)).unwrap();
        let errors = Arc::clone(errors);
        let options = async_nats::ConnectOptions::with_nkey(seed)
            .add_root_certificates(self.tls.path("ca.pem"))
            .custom_inbox_prefix(if user == "TRAINER" { "_INBOX_TRAINER" } else { "_INBOX" })
            .event_callback(move |event| {
                let errors = Arc::clone(&errors);
                async move {
                    if let async_nats::Event::ServerError(error) = event {
                        errors.lock().unwrap().push(error.to_string());
                    }
                }
            });
        options.connect(self.server.tls_url()).await.unwrap()
    }
}

/// Borrows options of a command.
pub(crate) fn as_strs(options: &[String]) -> Vec<&str> {
    options.iter().map(String::as_str).collect()
}
