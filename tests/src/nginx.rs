//! nginx in front of one server or several, with the program that `scripts/nginx` installs.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::{ApiClient, child_group, wait_until};

/// nginx on a free port. Dropping it ends the process.
#[derive(Debug)]
pub struct NginxProxy {
    process: Child,
    url: String,
    _folder: tempfile::TempDir,
}

impl NginxProxy {
    /// Starts nginx in front of one server, with default settings.
    ///
    /// # Panics
    /// Panics if nginx is missing or does not start.
    pub async fn start(server: &str) -> Self {
        let block =
            |listen: &str| format!("server {{ listen {listen}; location / {{ proxy_pass {server}; }} }}");
        Self::start_with(block).await
    }

    /// Starts nginx with the settings inside of `http`, which `settings` returns for the address to listen on.
    ///
    /// # Panics
    /// Panics if nginx is missing or does not start.
    pub async fn start_with(settings: impl Fn(&str) -> String) -> Self {
        let program =
            std::env::var_os("NGINX").map_or_else(|| PathBuf::from("/usr/sbin/nginx"), PathBuf::from);
        assert!(program.exists(), "{} is missing: run scripts/nginx, or set NGINX", program.display());
        let folder = tempfile::tempdir().expect("a folder");
        let address = free_address();
        let root = folder.path().display();
        // Only root may write to the standard paths.
        let paths = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|name| format!("{name}_temp_path {root}/{name};"))
            .concat();
        let settings = format!(
            "daemon off; master_process off; pid {root}/pid; events {{}}\nhttp {{ access_log off; {paths}\n{}\n}}",
            settings(&address)
        );
        let file = folder.path().join("nginx.conf");
        std::fs::write(&file, settings).expect("a file");
        let process = spawn(&program, &file, folder.path());
        let nginx = Self { process, url: format!("http://{address}"), _folder: folder };
        let api = nginx.api();
        wait_until("nginx forwards requests", async || {
            let response = api.try_request("GET", "/livez", "application/json", "").await;
            response.is_ok_and(|response| response.status == 200)
        })
        .await;
        nginx
    }

    /// URL that nginx listens on.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Creates a client of the servers behind nginx.
    #[must_use]
    pub fn api(&self) -> ApiClient {
        ApiClient::new(&self.url)
    }
}

impl Drop for NginxProxy {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn spawn(program: &Path, file: &Path, folder: &Path) -> Child {
    let mut command = Command::new(program);
    command.arg("-p").arg(folder).arg("-c").arg(file).args(["-e", "stderr"]);
    child_group::join(&mut command);
    command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().expect("nginx starts")
}

/// Returns an address of the loopback interface that was free a moment ago.
///
/// # Panics
/// Panics if the system has no free port.
#[must_use]
pub fn free_address() -> String {
    let probe = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    probe.local_addr().expect("an address").to_string()
}
