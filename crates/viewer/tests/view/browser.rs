//! Chromium without a window, driven as a user would: its DevTools protocol over two pipes, JSON messages that end with a zero byte
//! (`--remote-debugging-pipe`: it reads file descriptor 3 and writes to 4).

use serde_json::{Value, json};
use std::env;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// What Chromium is called, unless `MAPWRIGHT_CHROMIUM` says where it is.
const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// A busy machine takes its time.
const PATIENCE: Duration = Duration::from_secs(90);

/// A browser with one page open.
pub(crate) struct Browser {
    child: Child,
    stdin: ChildStdin,
    answers: Receiver<Value>,
    next_id: u64,
    session: Option<String>,
}

/// Where it is, if it is installed.
pub(crate) fn chromium() -> Option<PathBuf> {
    if let Some(path) = env::var_os("MAPWRIGHT_CHROMIUM") {
        return Some(PathBuf::from(path)).filter(|path| path.is_file());
    }
    let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH")?).collect();
    NAMES.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file())
}

impl Browser {
    /// Opens an address; `profile` is an empty folder.
    pub(crate) fn open_url(chromium: &Path, profile: &Path, url: &str) -> Self {
        let mut child = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 >&2 </dev/null"])
            .arg(chromium)
            .args([
                "--headless",
                "--no-sandbox",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--disable-dev-shm-usage",
                "--no-first-run",
            ])
            .args(["--remote-debugging-pipe", "--window-size=1300,1000"])
            .arg(format!("--user-data-dir={}", profile.display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (stdin, stdout) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let (told, answers) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(stdout).split(0).map_while(Result::ok) {
                let answer = serde_json::from_slice(&message);
                if answer.is_ok_and(|answer: Value| told.send(answer).is_err()) {
                    break;
                }
            }
        });
        let mut browser = Self { child, stdin, answers, next_id: 0, session: None };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        browser.session = attached["sessionId"].as_str().map(str::to_owned);
        browser.call("Page.bringToFront", &json!({}));
        browser.call("Network.enable", &json!({}));
        let tell = "addEventListener('error', (event) => { document.documentElement.dataset.fault = event.message; })";
        browser.call("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": tell }));
        browser.call("Page.navigate", &json!({ "url": url }));
        browser.wait_for("document.querySelector('#status') !== null");
        browser
    }

    /// What a command results in.
    pub(crate) fn call(&mut self, method: &str, parameters: &Value) -> Value {
        let answer = self.answer(method, parameters);
        assert!(answer["error"].is_null(), "{method}: {answer}");
        answer["result"].clone()
    }

    /// The answer to a command, be it an error.
    fn answer(&mut self, method: &str, parameters: &Value) -> Value {
        self.next_id += 1;
        let mut message = json!({ "id": self.next_id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.stdin.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.answers.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("no answer to {method}"));
            if answer["id"] == self.next_id {
                return answer;
            }
        }
    }

    /// What an expression is.
    pub(crate) fn value(&mut self, expression: &str) -> Value {
        let answer = self.call("Runtime.evaluate", &json!({ "expression": expression, "returnByValue": true }));
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    pub(crate) fn text(&mut self, expression: &str) -> String {
        self.value(expression).as_str().unwrap_or_default().to_owned()
    }

    /// Waits until an expression is true; while a page is being loaded it may have no value.
    pub(crate) fn wait_for(&mut self, expression: &str) {
        let begun = Instant::now();
        let parameters = json!({ "expression": expression, "returnByValue": true });
        while self.answer("Runtime.evaluate", &parameters)["result"]["result"]["value"] != true {
            if begun.elapsed() > PATIENCE {
                let state = "JSON.stringify({ ...document.documentElement.dataset, text: document.body.innerText.slice(0, 200) })";
                panic!("waited for {expression}: {}", self.text(state));
            }
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// Presses a key, by its name and number, and where it types something by that.
    pub(crate) fn key(&mut self, key: &str, code: u32, text: &str) {
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({ "type": kind, "key": key, "windowsVirtualKeyCode": code });
            if kind == "keyDown" && !text.is_empty() {
                event["text"] = json!(text);
            }
            self.call("Input.dispatchKeyEvent", &event);
        }
    }
}

impl Drop for Browser {
    /// Asks it to close, so that no process of it is left behind.
    fn drop(&mut self) {
        let _ = self.stdin.write_all(b"{\"id\":0,\"method\":\"Browser.close\"}\0"); // it may have ended by itself
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(10) {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
