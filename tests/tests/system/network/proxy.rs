//! The server behind nginx with its default settings: HTTP/1.0 towards the server, and responses in buffers.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::{ApiClient, ServerProcess, http_client, wait_until};

/// Time in which an event must pass the proxy.
const DELIVERY: Duration = Duration::from_secs(5);

/// nginx in front of one server. Dropping it ends the process.
struct Nginx {
    process: Child,
    url: String,
    _folder: tempfile::TempDir,
}

impl Nginx {
    /// Starts nginx on a free port. Its settings are the defaults, except for paths that only root may write.
    async fn start(server: &str) -> Self {
        let program =
            std::env::var_os("NGINX").map_or_else(|| PathBuf::from("/usr/sbin/nginx"), PathBuf::from);
        assert!(program.exists(), "{} is missing: run scripts/nginx, or set NGINX", program.display());
        let folder = tempfile::tempdir().unwrap();
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let root = folder.path().display();
        let paths = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|name| format!("{name}_temp_path {root}/{name};"))
            .concat();
        let settings = format!(
            "daemon off; master_process off; pid {root}/pid; events {{}} \
             http {{ access_log off; {paths} server {{ listen 127.0.0.1:{port}; \
             location / {{ proxy_pass {server}; }} }} }}"
        );
        let file = folder.path().join("nginx.conf");
        std::fs::write(&file, settings).unwrap();
        let process = Self::spawn(&program, &file, folder.path());
        let nginx = Self { process, url: format!("http://127.0.0.1:{port}"), _folder: folder };
        let api = nginx.api();
        wait_until("nginx forwards requests", async || {
            let response = api.try_request("GET", "/livez", "application/json", "").await;
            response.is_ok_and(|response| response.status == 200)
        })
        .await;
        nginx
    }

    fn spawn(program: &Path, file: &Path, folder: &Path) -> Child {
        let mut command = Command::new(program);
        command.arg("-p").arg(folder).arg("-c").arg(file).args(["-e", "stderr"]);
        command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().expect("nginx starts")
    }

    fn api(&self) -> ApiClient {
        ApiClient::new(&self.url)
    }
}

impl Drop for Nginx {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn events_pass_nginx_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let nginx = Nginx::start(server.api().base()).await;
    let api = nginx.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "design": {"designer": "off"}})).await.expect(201);
    let events = format!("{}/v1/runs/run/events", api.base());
    let opened = Instant::now();
    let mut stream = tokio::time::timeout(DELIVERY, http_client().get(events).send())
        .await
        .expect("nginx passes the head of the stream on at once")
        .unwrap();
    assert_eq!(stream.headers()["cache-control"], "no-store, no-transform");
    let mut text = String::new();
    for action in ["pause", "resume"] {
        let _ = api.post(&format!("/v1/runs/run/{action}"), json!({})).await.expect(200);
        let state = format!("{action}d");
        while !text.contains(&state) {
            let part = tokio::time::timeout(DELIVERY, stream.chunk()).await;
            let part = part.unwrap_or_else(|_| panic!("nginx withholds the event {state}: {text:?}"));
            text.push_str(&String::from_utf8_lossy(&part.unwrap().expect("the stream goes on")));
        }
    }
    assert!(opened.elapsed() < 3 * DELIVERY, "{:?}", opened.elapsed());
}

#[tokio::test(flavor = "multi_thread")]
async fn long_poll_passes_nginx() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let nginx = Nginx::start(server.api().base()).await;
    let api = nginx.api();
    let run = json!({"id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", run).await.expect(201);
    let empty = api.get("/v1/runs/run/trajectories?wait_s=1").await.expect(200);
    assert_eq!(empty["groups"], json!([]));
    let wait = tokio::spawn({
        let api = api.clone();
        async move { api.get("/v1/runs/run/trajectories?wait_s=60").await }
    });
    let _ = api.send_json("PUT", "/v1/runs/run/policy", json!({"policy": "hold"})).await.expect(200);
    let page = wait.await.unwrap().expect(200);
    assert!(!page["groups"].as_array().unwrap().is_empty(), "{page}");
}
