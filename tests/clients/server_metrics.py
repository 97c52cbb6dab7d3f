"""Reads numbers of a server's metrics for the scripts of this folder."""
import urllib.request


def read_gauge(url, name):
    """Returns the value of a gauge without labels; 0 if the server has none with this name."""
    with urllib.request.urlopen(url + "/metrics") as response:
        lines = response.read().decode().splitlines()
    values = [line.split()[1] for line in lines if line.startswith(name + " ")]
    return float(values[0]) if values else 0.0
