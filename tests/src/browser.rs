//! A browser without a window, by WebDriver (<https://www.w3.org/TR/webdriver2/>): `chromedriver` is started, and asked
//! over HTTP on this machine.

use crate::scenes::skip;
use serde_json::{Value, json};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit for loading a page or running a script.
const PATIENCE: Duration = Duration::from_secs(120);

/// Chromium with a profile of its own, closed when this is dropped.
#[derive(Debug)]
pub struct Browser {
    driver: Child,
    port: u16,
    session: String,
    // Removed after the browser has ended.
    _profile: tempfile::TempDir,
}

fn found(program: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders)
        .map(|folder| folder.join(program))
        .find(|path| path.is_file())
}

impl Browser {
    /// Starts a browser of `width` × `height` pixels; without one, says so and returns `None`.
    ///
    /// # Panics
    /// When there is none and `HEMICUBE_REQUIRE_BROWSER=1`, or it is there and does not start.
    pub fn start(test: &str, width: u32, height: u32) -> Option<Self> {
        let (Some(chromium), Some(chromedriver)) = (found("chromium"), found("chromedriver")) else {
            skip(test, "no Chromium with its driver", "HEMICUBE_REQUIRE_BROWSER");
            return None;
        };
        let profile = tempfile::tempdir().expect("a temporary directory");
        let mut driver = Command::new(chromedriver)
            .arg("--port=0")
            .env("HOME", profile.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver starts");
        let mut lines = BufReader::new(driver.stdout.take().expect("its output")).lines();
        let port = lines
            .by_ref()
            .map_while(Result::ok)
            .find_map(|line| {
                let port = line.split_once("started successfully on port ")?.1;
                port.trim_end_matches('.').parse().ok()
            })
            .expect("chromedriver says its port");
        let mut browser = Self {
            driver,
            port,
            session: String::new(),
            _profile: profile,
        };
        let data = browser._profile.path().join("data");
        let arguments = [
            "--headless".to_owned(),
            // Containers run it as root, without a sandbox and with little shared memory.
            "--no-sandbox".to_owned(),
            "--disable-dev-shm-usage".to_owned(),
            "--disable-gpu".to_owned(),
            "--use-gl=angle".to_owned(),
            "--use-angle=swiftshader".to_owned(),
            "--enable-unsafe-swiftshader".to_owned(),
            "--disable-background-networking".to_owned(),
            "--disable-component-update".to_owned(),
            "--disable-sync".to_owned(),
            "--no-first-run".to_owned(),
            "--hide-scrollbars".to_owned(),
            format!("--user-data-dir={}", data.display()),
            format!("--window-size={width},{height}"),
        ];
        let made = browser.ask(
            "POST",
            "/session",
            &json!({ "capabilities": { "alwaysMatch": {
                "browserName": "chrome",
                "goog:chromeOptions": { "binary": chromium, "args": arguments },
                "goog:loggingPrefs": { "browser": "ALL", "performance": "ALL" },
                "timeouts": { "script": 120_000, "pageLoad": 120_000 },
            } } }),
        );
        made["sessionId"]
            .as_str()
            .expect("a session")
            .clone_into(&mut browser.session);
        Some(browser)
    }

    /// Sends a request to the driver, and reads the answer.
    fn send(&self, method: &str, path: &str, body: &Value) -> io::Result<Value> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        let body = if method == "POST" {
            body.to_string()
        } else {
            String::new()
        };
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nContent-Type: application/json\r\n\
             Content-Length: {}\r\n\r\n{body}",
            body.len()
        )?;
        let mut reader = BufReader::new(stream);
        let (mut length, mut line) = (0, String::new());
        loop {
            line.clear();
            reader.read_line(&mut line)?;
            let header = line.trim_end().to_ascii_lowercase();
            if let Some(value) = header.strip_prefix("content-length:") {
                length = value.trim().parse().map_err(io::Error::other)?;
            }
            if header.is_empty() {
                break;
            }
        }
        let mut bytes = vec![0; length];
        reader.read_exact(&mut bytes)?;
        Ok(serde_json::from_slice(&bytes)?)
    }

    /// Asks the driver for something it must be able to do.
    fn ask(&self, method: &str, path: &str, body: &Value) -> Value {
        let answer = self
            .send(method, path, body)
            .unwrap_or_else(|error| panic!("{method} {path}: {error}"));
        let value = answer["value"].clone();
        assert!(value.get("error").is_none(), "{method} {path}: {value}");
        value
    }

    fn of_session(&self, method: &str, path: &str, body: &Value) -> Value {
        self.ask(method, &format!("/session/{}{path}", self.session), body)
    }

    /// Opens a file from the disk.
    pub fn open(&self, path: &Path) {
        let path = path.canonicalize().expect("the page is there");
        let url = format!("file://{}", path.display());
        self.of_session("POST", "/url", &json!({ "url": url }));
    }

    /// Runs the body of an `async` function in the page, and returns its result.
    pub fn script(&self, body: &str) -> Value {
        let script = format!(
            "const done = arguments[0];
            (async () => {{ {body} }})().then(done, error => done({{ thrown: String(error) }}))"
        );
        let value = self.of_session("POST", "/execute/async", &json!({ "script": script, "args": [] }));
        assert!(value.get("thrown").is_none(), "{body}: {value}");
        value
    }

    /// Waits until an expression is true.
    ///
    /// # Panics
    /// When it does not become true.
    #[track_caller]
    pub fn wait(&self, expression: &str) {
        let started = Instant::now();
        while self.script(&format!("return !!({expression})")) != Value::Bool(true) {
            assert!(
                started.elapsed() < PATIENCE,
                "`{expression}` does not become true: {:?}",
                self.log("browser")
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Messages of the console (`browser`) or of the developers' tools (`performance`) since the last call.
    pub fn log(&self, kind: &str) -> Vec<Value> {
        let found = self.of_session("POST", "/se/log", &json!({ "type": kind }));
        found.as_array().cloned().unwrap_or_default()
    }

    /// Addresses asked for since the last call of this or of [`Self::log`] with `performance`.
    pub fn requests(&self) -> Vec<String> {
        let events = self.log("performance");
        let events = events.iter().filter_map(|entry| {
            let message: Value = serde_json::from_str(entry["message"].as_str()?).ok()?;
            let message = &message["message"];
            (message["method"] == "Network.requestWillBeSent")
                .then(|| message["params"]["request"]["url"].as_str().unwrap_or("").to_owned())
        });
        events.collect()
    }

    /// Presses the main button at the first place, goes to the others, and lets go; in pixels of the visible page.
    pub fn drag(&self, places: &[[f64; 2]]) {
        let go = |&[x, y]: &[f64; 2]| {
            let (x, y) = (x.round(), y.round());
            json!({ "type": "pointerMove", "duration": 50, "x": x, "y": y })
        };
        let mut actions = vec![go(&places[0]), json!({ "type": "pointerDown", "button": 0 })];
        actions.extend(places[1..].iter().map(go));
        actions.push(json!({ "type": "pointerUp", "button": 0 }));
        self.of_session(
            "POST",
            "/actions",
            &json!({ "actions": [{
                "type": "pointer", "id": "mouse", "parameters": { "pointerType": "mouse" }, "actions": actions,
            }] }),
        );
    }

    /// Gives the window another size.
    pub fn resize(&self, width: u32, height: u32) {
        self.of_session("POST", "/window/rect", &json!({ "width": width, "height": height }));
    }

    /// The visible page, as PNG.
    pub fn screenshot(&self) -> Vec<u8> {
        let value = self.of_session("GET", "/screenshot", &Value::Null);
        from_base64(value.as_str().expect("a picture"))
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Ends the browser, also after a failed test; errors mean that it has ended.
        let _ = self.send("DELETE", &format!("/session/{}", self.session), &Value::Null);
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// RFC 4648.
fn from_base64(text: &str) -> Vec<u8> {
    let value = |letter: u8| {
        u32::from(match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            other => panic!("{other} is no base64"),
        })
    };
    let letters: Vec<u8> = text
        .bytes()
        .filter(|letter| *letter != b'=' && !letter.is_ascii_whitespace())
        .collect();
    let mut bytes = Vec::with_capacity(letters.len() / 4 * 3);
    for chunk in letters.chunks(4) {
        let bits = chunk.iter().fold(0, |bits, &letter| bits << 6 | value(letter)) << (6 * (4 - chunk.len()));
        bytes.extend_from_slice(&bits.to_be_bytes()[1..chunk.len()]);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_64_as_in_the_rfc() {
        for (text, bytes) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9vYmFy", "foobar")] {
            assert_eq!(from_base64(text), bytes.as_bytes());
        }
    }
}
