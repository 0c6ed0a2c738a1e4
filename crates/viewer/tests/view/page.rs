//! The page in Chromium, as somebody sees and uses it. Without Chromium nothing is tested, which is said.

use crate::browser::{Browser, chromium};
use crate::rooms::{Rooms, objection};
use crate::{PATIENCE, drive_until, pose, viewer};
use base64::Engine;
use mapwright_record::{Objection, Verdict};
use mapwright_viewer::{Settings, Viewer};
use serde_json::json;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// An empty folder of its own, away when it is dropped.
struct Profile(PathBuf);

impl Profile {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("mapwright-view-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }
}

impl Drop for Profile {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0); // the browser may still write there
    }
}

/// How many grey levels or colours a picture has, and how many of its pixels are not of the most frequent one.
fn colours(png: &[u8]) -> (usize, f64) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let mut counts = std::collections::BTreeMap::new();
    let size = info.color_type.samples();
    pixels.chunks(size).for_each(|pixel| *counts.entry(pixel.to_vec()).or_insert(0_usize) += 1);
    let (most, all) = (counts.values().max().copied().unwrap_or(0), counts.values().sum::<usize>());
    (counts.len(), 1.0 - most as f64 / all.max(1) as f64)
}

fn picture(browser: &mut Browser, name: &str) -> Vec<u8> {
    let answer = browser.call("Page.captureScreenshot", &json!({ "format": "png" }));
    let png = base64::engine::general_purpose::STANDARD.decode(answer["data"].as_str().unwrap()).unwrap();
    if let Some(folder) = std::env::var_os("MAPWRIGHT_PICTURES") {
        fs::write(PathBuf::from(folder).join(format!("{name}.png")), &png).unwrap();
    }
    png
}

#[test]
fn a_run_is_seen_as_it_grows() {
    let Some(chromium) = chromium() else {
        println!("skipped: no Chromium; MAPWRIGHT_CHROMIUM says where it is");
        return;
    };
    let (mut viewer, mut rooms) = (viewer(), Rooms::new(360));
    viewer.status(&[("dropped".into(), "3 scans (overtaken by newer ones)".into())]);
    let profile = Profile::new("grows");
    let url = viewer.url();
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let looks = scope.spawn(|| {
            let mut browser = Browser::open_url(&chromium, &profile.0, &url);
            browser.wait_for("Number(document.documentElement.dataset.messages) > 5");
            browser.wait_for("document.querySelector('#status').textContent === 'tracking'");
            browser.wait_for("document.querySelectorAll('#events li').length >= 3");
            browser.key("0", 48, "0");
            browser.wait_for("document.querySelector('#follow').getAttribute('aria-pressed') === 'false'");
            let events = browser.text("document.querySelector('#events').textContent");
            for word in ["proposed 5 → 30", "accepted 2 → 20", "refused 3 → 25", Objection::Ambiguous.in_words()] {
                assert!(events.contains(word), "{word}: {events}");
            }
            assert!(browser.text("document.querySelector('#lines').textContent").contains("overtaken by newer ones"));
            let light = colours(&picture(&mut browser, "light"));
            assert!(light.0 > 20 && light.1 > 0.2, "{light:?}");
            browser.key("d", 68, "d");
            browser.wait_for("document.documentElement.classList.contains('dark')");
            let dark = colours(&picture(&mut browser, "dark"));
            assert!(dark.0 > 20 && dark.1 > 0.2, "{dark:?}");
            browser.key("?", 191, "?");
            browser.wait_for("!document.querySelector('#help').hidden");
            picture(&mut browser, "help");
            browser.key("Escape", 27, "");
            browser.wait_for("document.querySelector('#help').hidden");
            browser.key(" ", 32, " ");
            browser.wait_for("document.querySelector('#pause').getAttribute('aria-pressed') === 'true'");
            let phone = json!({ "width": 390, "height": 780, "deviceScaleFactor": 2, "mobile": true });
            browser.call("Emulation.setDeviceMetricsOverride", &phone);
            browser.key(" ", 32, " ");
            browser.key("0", 48, "0");
            let before = browser.value("Number(document.documentElement.dataset.messages)").as_u64().unwrap();
            browser.wait_for(&format!("Number(document.documentElement.dataset.messages) > {}", before + 3));
            assert_eq!(browser.value("document.documentElement.scrollWidth <= innerWidth"), true);
            let overlap = "(() => { const [a, b, c] = ['state', 'closures', 'tools'].map((name) => document.getElementById(name).getBoundingClientRect()); \
                           return a.bottom > b.top || b.bottom > c.top; })()";
            assert_eq!(browser.value(overlap), false, "boxes overlap on a phone");
            picture(&mut browser, "phone");
            assert_eq!(browser.value("document.documentElement.dataset.fault ?? 'none'"), "none");
            is_over.store(true, Ordering::Relaxed);
        });
        let begun = Instant::now();
        drive_until(&mut viewer, &mut rooms, |viewer| viewer.watching() > 0);
        let mut round = 0;
        while !looks.is_finished() {
            round += 1;
            assert!(begun.elapsed() < 4 * PATIENCE, "the browser takes too long");
            let at = pose(rooms.session.keyframes().len() as u32 % 300);
            let update = rooms.keyframe(at, at);
            viewer.show(&update, &rooms.session);
            let candidate = match round {
                60 => Some(rooms.candidate(2, 20, Verdict::Accepted)),
                80 => Some(rooms.candidate(3, 25, Verdict::Refused(objection(0)))),
                100 => Some(rooms.candidate(5, 30, Verdict::Waiting(Objection::Alone))),
                _ => None,
            };
            candidate.into_iter().for_each(|update| viewer.show(&update, &rooms.session));
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        looks.join().unwrap();
    });
    assert!(is_over.load(Ordering::Relaxed));
}

#[test]
fn a_finished_run_has_a_time_line() {
    let Some(chromium) = chromium() else {
        println!("skipped: no Chromium; MAPWRIGHT_CHROMIUM says where it is");
        return;
    };
    let viewer = Viewer::replay(Settings::default(), crate::PEN, crate::replay::run()).unwrap();
    let profile = Profile::new("time-line");
    let mut browser = Browser::open_url(&chromium, &profile.0, &viewer.url());
    browser.wait_for("!document.querySelector('#clock').hidden && Number(document.querySelector('#time').max) > 5");
    browser.wait_for("document.querySelector('#at').textContent === '0:05.9 of 0:05.9'");
    browser.wait_for("document.querySelector('#where').textContent.endsWith('60 keyframes')");
    browser.value("(() => { const time = document.querySelector('#time'); time.value = 2.05; time.dispatchEvent(new Event('input')); time.dispatchEvent(new Event('change')); })()");
    browser.wait_for("document.querySelector('#where').textContent.endsWith('21 keyframes')");
    browser.key("0", 48, "0");
    let (count, share) = colours(&picture(&mut browser, "replay"));
    assert!(count > 20 && share > 0.2, "{count} colours, {share}");
}
