//! The page beyond this machine: TLS, a login, and nothing without.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]
#![cfg(unix)]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use tessera_tests::loopback;
use tessera_tests::program::{Running, coordinator, run};
use tessera_tests::web::{Answer, OWN_REQUEST, Secure, http};

/// A farm whose page others can reach.
struct Open {
    folder: tempfile::TempDir,
    port: u16,
    _serve: Running,
    said: String,
}

impl Open {
    fn start() -> Self {
        let (folder, port) = (tempfile::tempdir().unwrap(), loopback::free().port());
        let (http, listen) = (format!("0.0.0.0:{port}"), format!("127.0.0.1:{}", loopback::free().port()));
        let args = ["serve", "--state", "farm", "--listen", &listen, "--http", &http];
        let mut command = coordinator(folder.path(), args);
        command.env("XDG_STATE_HOME", folder.path()).env_remove("TESSERA_TOKEN");
        let mut serve = Running::start(&mut command);
        let said = serve.line(|line| line.contains("the page is at")).unwrap();
        Self { folder, port, _serve: serve, said }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join("tessera").join(name)
    }

    fn token(&self, name: &str) -> String {
        std::fs::read_to_string(self.file(name)).unwrap().trim().to_owned()
    }

    fn ask(&self, method: &str, path: &str, more: &str, body: &str) -> Answer {
        Secure::knowing(&self.file("authority.pem")).ask(self.port, (method, path, more), body)
    }

    fn get(&self, path: &str, more: &str) -> Answer {
        self.ask("GET", path, more, "")
    }

    /// Logs in; gives the line of a head that shows it.
    fn session(&self) -> String {
        let answer = self.ask("POST", "/login", OWN_REQUEST, &self.token("user-token"));
        assert_eq!(answer.status, 204, "{}", answer.head);
        let cookie = answer.header("set-cookie").unwrap();
        for kept in ["__Host-", "; Secure", "; HttpOnly", "; SameSite=Strict", "; Path=/"] {
            assert!(cookie.contains(kept), "{cookie}");
        }
        format!("Cookie: {}\r\n", cookie.split(';').next().unwrap())
    }
}

#[test]
fn nothing_is_answered_without_a_login() {
    let farm = Open::start();
    assert!(farm.said.contains("https://"), "{}", farm.said);
    for path in ["/app.js", "/api/v1/jobs", "/api/v1/jobs/1", "/api/v1/events", "/metrics", "/nowhere"] {
        let answer = farm.get(path, "");
        assert_eq!((answer.status, answer.header("www-authenticate")), (401, Some("Bearer")), "{path}");
        let forged = format!("Cookie: __Host-tessera={}\r\n", "A".repeat(22));
        assert_eq!(farm.get(path, &forged).status, 401, "{path}");
    }
    // Whoever opens the page sees where to log in, and nothing else.
    let page = farm.get("/", "");
    assert_eq!(page.status, 401);
    assert!(String::from_utf8_lossy(&page.body).contains("id=\"login\""));
    for path in ["/login", "/login.js", "/login.css", "/healthz", "/readyz"] {
        assert_eq!(farm.get(path, "").status, 200, "{path}");
    }
    assert_eq!(farm.ask("POST", "/api/v1/jobs/1/cancel", OWN_REQUEST, "").status, 401);
    // Without TLS there is only a word of where it is.
    let plain = http(&format!("127.0.0.1:{}", farm.port), "GET", "/login", "");
    assert!(plain.status == 400 && String::from_utf8_lossy(&plain.body).contains("https"), "{}", plain.head);
}

#[test]
fn the_users_token_logs_in_and_no_other() {
    let farm = Open::start();
    let user = farm.token("user-token");
    let workers = run(farm.folder.path(), ["token", "--help"]);
    assert_eq!(workers.code, Some(0));
    let session = farm.session();
    assert_eq!(farm.get("/", &session).status, 200);
    assert_eq!(farm.get("/api/v1/jobs", &session).status, 200);
    assert_eq!(farm.get("/api/v1/jobs", &format!("Cookie: a=b\r\n{session}")).status, 200);
    assert_eq!(farm.get("/api/v1/jobs", &format!("Authorization: Bearer {user}\r\n")).status, 200);
    let secret = user.rsplit('.').next().unwrap();
    assert_eq!(farm.get("/api/v1/jobs", &format!("Authorization: Bearer {secret}\r\n")).status, 200);

    // Each wrong one is answered later than the one before.
    let mut last = Duration::ZERO;
    let wrong = format!("{}{}", &user[..user.len() - 22], "A".repeat(22));
    for _ in 0..3 {
        let start = Instant::now();
        assert_eq!(farm.ask("POST", "/login", OWN_REQUEST, &wrong).status, 401);
        let least = if last == Duration::ZERO { Duration::from_millis(100) } else { 2 * last };
        assert!(start.elapsed() >= least, "{:?}", start.elapsed());
        last = least;
    }
    assert_eq!(farm.get("/api/v1/jobs", &format!("Authorization: Bearer {wrong}\r\n")).status, 401);
    assert_eq!(farm.get("/api/v1/jobs", &format!("Authorization: Basic {user}\r\n")).status, 401);
    let metrics = farm.get("/metrics", &session);
    let said = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(said.contains("tessera_refused_total 5"), "{said}");

    // Another begins and ends; the first goes on, until the token is another.
    let second = farm.session();
    assert_eq!(farm.ask("POST", "/logout", &format!("{OWN_REQUEST}{second}"), "").status, 204);
    assert_eq!((farm.get("/", &second).status, farm.get("/", &session).status), (401, 200));
    let mut renew = coordinator(farm.folder.path(), ["token", "renew", "--user"]);
    assert!(renew.env("XDG_STATE_HOME", farm.folder.path()).output().unwrap().status.success());
    assert_eq!(farm.get("/", &session).status, 401, "the token was renewed");
    assert_eq!(farm.get("/", &farm.session()).status, 200);
}

#[test]
fn no_other_site_logs_in_or_changes_anything() {
    let farm = Open::start();
    let (session, token) = (farm.session(), farm.token("user-token"));
    let own = format!("Origin: https://localhost:{}\r\nSec-Fetch-Site: same-origin\r\n", farm.port);
    let cancel = |more: &str| farm.ask("POST", "/api/v1/jobs/1/cancel", more, "").status;
    let bearer = format!("Authorization: Bearer {token}\r\n");
    for foreign in ["Origin: https://evil.example\r\n", "Origin: null\r\n", "Sec-Fetch-Site: cross-site\r\n"] {
        assert_eq!(cancel(&format!("{session}{OWN_REQUEST}{foreign}")), 403, "{foreign}");
        assert_eq!(cancel(&format!("{bearer}{foreign}")), 403, "{foreign}");
        assert_eq!(farm.ask("POST", "/login", &format!("{OWN_REQUEST}{foreign}"), &token).status, 403, "{foreign}");
        assert_eq!(
            farm.ask("POST", "/logout", &format!("{session}{OWN_REQUEST}{foreign}"), "").status,
            403,
            "{foreign}"
        );
    }
    // What a form could send is not enough, wherever it is.
    assert_eq!(cancel(&format!("{session}{own}")), 403);
    assert_eq!(farm.ask("POST", "/login", &own, &token).status, 403);
    // From the page itself it is heard: there is no such job.
    assert_eq!(cancel(&format!("{session}{OWN_REQUEST}{own}")), 404);
    assert_eq!(cancel(&bearer), 404);
}

#[test]
fn there_is_no_page_beyond_this_machine_without_tls() {
    let folder = tempfile::tempdir().unwrap();
    let refused = run(
        folder.path(),
        ["serve", "--state", "farm", "--listen", "127.0.0.1:0", "--http", "0.0.0.0:0", "--insecure"],
    );
    assert!(refused.code == Some(2) && refused.err.contains("--insecure"), "{}", refused.err);
}
