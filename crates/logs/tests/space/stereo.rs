//! Images of two cameras: which topics, what their cameras are, and what is wrong with them.

use super::*;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 80;
/// A distortion of the equidistant model.
const FISHEYE: &[f64] = &[0.1, 0.02, 0.001, 0.0];

/// A number that looks random, by its place.
fn value(x: u32, y: u32) -> u8 {
    let mixed = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2c1b_3c6d);
    (mixed >> 13) as u8
}

/// A wall that the right camera sees `shift` pixels further left.
fn wall(shift: u32) -> Vec<u8> {
    (0..WIDTH * HEIGHT).map(|k| value(k % WIDTH + shift, k / WIDTH)).collect()
}

fn png(pixels: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, WIDTH, HEIGHT);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    file
}

impl Recorder {
    fn info(&mut self, topic: &str, baseline_m: f64, change: impl FnOnce(&mut CameraInfo<'_>)) {
        let mut p = [0.0; 12];
        [p[0], p[2], p[3], p[5], p[6], p[10]] = [100.0, 79.5, -100.0 * baseline_m, 100.0, 39.5, 1.0];
        let mut info = CameraInfo {
            header: Header::new(ms(0), "left_optical"),
            width: WIDTH,
            height: HEIGHT,
            distortion_model: "plumb_bob".into(),
            k: Fixed([100.0, 0.0, 79.5, 0.0, 100.0, 39.5, 0.0, 0.0, 1.0]),
            r: Fixed([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
            p: Fixed(p),
            ..Default::default()
        };
        change(&mut info);
        self.write(topic, "sensor_msgs/msg/CameraInfo", ms(0), &info);
    }

    fn image(&mut self, topic: &str, at_ms: i64, encoding: &'static str, data: &[u8]) {
        let image = Image {
            header: Header::new(ms(at_ms), "left_optical"),
            width: WIDTH,
            height: HEIGHT,
            encoding: encoding.into(),
            step: data.len() as u32 / HEIGHT,
            data,
            ..Default::default()
        };
        self.write(topic, IMAGE, ms(at_ms), &image);
    }

    fn file(&mut self, topic: &str, at_ms: i64, data: &[u8]) {
        let header = Header::new(ms(at_ms), "left_optical");
        let image = CompressedImage { header, format: "mono8; png compressed".into(), data };
        self.write(topic, "sensor_msgs/msg/CompressedImage", ms(at_ms), &image);
    }
}

/// A pair of cameras whose topics end so, the wall 2.5 m ahead.
fn pair(name: &str, ending: &str, change: impl Fn(&mut CameraInfo<'_>)) -> Recorder {
    let mut recorder = Recorder::new(name);
    recorder.info("/stereo/left/camera_info", 0.0, &change);
    recorder.info("/stereo/right/camera_info", 0.2, &change);
    for k in 0..3 {
        recorder.image(&format!("/stereo/left/{ending}"), 100 * k, "mono8", &wall(0));
        recorder.image(&format!("/stereo/right/{ending}"), 100 * k + 1, "mono8", &wall(8));
    }
    recorder
}

fn assert_walls(clouds: &[Cloud], count: usize) {
    assert_eq!(clouds.len(), count);
    for cloud in clouds {
        let known: Vec<f32> = cloud.points_m.iter().map(|point| point[2]).filter(|z| z.is_finite()).collect();
        assert!(known.len() > (WIDTH * HEIGHT / 2) as usize, "{}", known.len());
        // at the edge of what the right camera sees a few are off by a pixel or more
        let right = known.iter().filter(|z| (**z - 2.5).abs() < 0.2).count();
        assert!(100 * right > 99 * known.len(), "{right} of {}", known.len());
        assert_eq!(cloud.sigmas_m.len(), cloud.points_m.len());
    }
}

#[test]
fn rectified_and_raw_pairs_are_mapped_by_what_their_cameras_say() {
    for (name, ending, which) in
        [("rect.mcap", "image_rect", "P of /stereo/left/camera_info"), ("raw.mcap", "image_raw", "K, D, R and P of")]
    {
        let path = pair(name, ending, |_| {}).finish();
        assert!(SpacePlan::is_default(&Survey::of(&path).unwrap(), &Choice::default()));
        let (clouds, notes, plan) = read(&path);
        assert_walls(&clouds, 3);
        assert!(notes.kinds.is_empty(), "{notes:?}");
        let reason = plan.reasons.iter().find(|(what, _)| *what == "camera").unwrap();
        assert!(reason.1.starts_with(which) && reason.1.contains("baseline 0.2000 m"), "{reason:?}");
        assert!((plan.sensor.range_sigma_per_m - 0.25 / 20.0).abs() < 1e-4, "{plan:?}");
        // of no other frame anything is said: the camera is the robot
        assert_eq!((plan.robot_frame.as_str(), plan.assumed.len()), ("left_optical", 0), "{plan:?}");
        assert!(plan.sensor.robot_from_sensor.distance(Pose3::identity()) < 1e-9);
    }
}

#[test]
fn rectification_undoes_how_the_right_camera_is_turned() {
    // the right camera looks 2 degrees aside: all that it sees lies 3.5 pixels beside where it should
    let (sin, cos) = 0.035_f64.sin_cos();
    let mut recorder = Recorder::new("turned.mcap");
    recorder.info("/left/camera_info", 0.0, |_| {});
    recorder.info("/right/camera_info", 0.2, |info| info.r = Fixed([cos, 0.0, -sin, 0.0, 1.0, 0.0, sin, 0.0, cos]));
    // a pattern four pixels wide, between whose values lines go
    let pattern = |u: f64, v: f64| {
        let (u, v) = (u / 4.0 + 40.0, v / 4.0 + 40.0);
        let at = |x: f64, y: f64| f64::from(value(x as u32, y as u32));
        let (i, j, a, b) = (u.floor(), v.floor(), u.fract(), v.fract());
        let row = |j: f64| at(i, j) * (1.0 - a) + at(i + 1.0, j) * a;
        (row(j) * (1.0 - b) + row(j + 1.0) * b) as u8
    };
    let in_right = |x: f64, y: f64| {
        let (a, b) = ((x - 79.5) / 100.0, (y - 39.5) / 100.0);
        let ahead = sin * a + cos;
        pattern(100.0 * (cos * a - sin) / ahead + 79.5 + 8.0, 100.0 * b / ahead + 39.5)
    };
    let pixels = || (0..WIDTH * HEIGHT).map(|k| (f64::from(k % WIDTH), f64::from(k / WIDTH)));
    let left: Vec<u8> = pixels().map(|(x, y)| pattern(x, y)).collect();
    let right: Vec<u8> = pixels().map(|(x, y)| in_right(x, y)).collect();
    recorder.image("/left/image_raw", 0, "mono8", &left);
    recorder.image("/right/image_raw", 0, "mono8", &right);
    let (clouds, _, _) = read(&recorder.finish());
    let middle: Vec<f32> = (20..60)
        .flat_map(|y| (60..140).map(move |x| y * WIDTH as usize + x))
        .map(|at| clouds[0].points_m[at][2])
        .filter(|z| z.is_finite())
        .collect();
    let right = middle.iter().filter(|z| (**z - 2.5).abs() < 0.35).count();
    assert!(middle.len() > 400 && 10 * right > 8 * middle.len(), "{right} of {}", middle.len());
}

#[test]
fn packed_images_colours_and_mosaics_are_read() {
    let mut recorder = Recorder::new("packed.mcap");
    recorder.info("/cam/left/camera_info", 0.0, |_| {});
    recorder.info("/cam/right/camera_info", 0.2, |_| {});
    recorder.file("/cam/left/image_rect/compressed", 0, &png(&wall(0)));
    recorder.file("/cam/right/image_rect/compressed", 0, &png(&wall(8)));
    let (clouds, notes, _) = read(&recorder.finish());
    assert!(notes.kinds.is_empty(), "{notes:?}");
    assert_walls(&clouds, 1);
    let mut recorder = Recorder::new("colours.mcap");
    recorder.info("/left/camera_info", 0.0, |_| {});
    recorder.info("/right/camera_info", 0.2, |_| {});
    let colours = |shift| wall(shift).into_iter().flat_map(|value| [value; 3]).collect::<Vec<_>>();
    recorder.image("/left/image_rect_color", 0, "bgr8", &colours(0));
    recorder.image("/right/image_rect_color", 0, "bgr8", &colours(8));
    let (clouds, _, _) = read(&recorder.finish());
    assert_walls(&clouds, 1);
}

#[test]
fn images_without_their_partner_are_counted() {
    let mut recorder = pair("alone.mcap", "image_rect", |_| {});
    recorder.image("/stereo/left/image_rect", 300, "mono8", &wall(0));
    recorder.image("/stereo/left/image_rect", 400, "mono8", &wall(0));
    recorder.image("/stereo/right/image_rect", 403, "mono8", &wall(8));
    recorder.image("/stereo/right/image_rect", 500, "mono8", &wall(8));
    recorder.image("/stereo/left/image_rect", 600, "mono8", &wall(0)[..100]);
    let (clouds, notes, _) = read(&recorder.finish());
    assert_walls(&clouds, 4);
    assert_eq!((notes.count(NoteKind::WithoutPartner), notes.count(NoteKind::UnreadableFrame)), (2, 1), "{notes:?}");
    assert!(notes.has_losses());
}

#[test]
fn cameras_that_are_no_pair_are_refused_with_what_to_type() {
    let told = |recorder: Recorder| plan(&recorder.finish(), &CameraOptions::default()).unwrap_err();
    let error = told(pair("zero.mcap", "image_rect", |info| info.p.0[0] = 0.0));
    assert!(error.contains("expected focal lengths above zero in P"), "{error}");
    let error = told(pair("fish.mcap", "image_raw", |info| {
        (info.distortion_model, info.d) = ("equidistant".into(), FISHEYE[..].into());
    }));
    assert!(error.contains("equidistant") && error.contains("record rectified images"), "{error}");
    let mut swapped = Recorder::new("swapped.mcap");
    swapped.info("/left/camera_info", 0.2, |_| {});
    swapped.info("/right/camera_info", 0.0, |_| {});
    swapped.image("/left/image_rect", 0, "mono8", &wall(8));
    swapped.image("/right/image_rect", 0, "mono8", &wall(0));
    let error = told(swapped);
    assert!(error.contains("are left and right swapped?"), "{error}");
    let bare = |name: &str| {
        let mut bare = Recorder::new(name);
        for k in 0..2 {
            bare.image("/cam0/image_rect", 100 * k, "mono8", &wall(0));
            bare.image("/cam1/image_rect", 100 * k, "mono8", &wall(8));
        }
        bare
    };
    let error = told(bare("bare.mcap"));
    assert!(error.contains("give --intrinsics FX,FY,CX,CY --baseline M"), "{error}");
    let path = bare("bare.mcap").finish();
    let asked = CameraOptions {
        intrinsics: Some([100.0, 100.0, 79.5, 39.5]),
        baseline_m: Some(0.2),
        ..CameraOptions::default()
    };
    assert_walls(&read_with(&path, &Choice::default(), &asked).0, 2);
    // asked for the other way around: the images say that they are swapped
    let choice = Choice { topics: vec!["/cam1/image_rect".into(), "/cam0/image_rect".into()], ..Choice::default() };
    let survey = Survey::of(&path).unwrap();
    let plan = SpacePlan::of(&survey, &choice, &asked).unwrap();
    let mut stream = SpaceStream::open("swapped", &path, survey, plan).unwrap();
    let error = loop {
        match stream.next_event() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("expected that no pair is one"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(error.contains("left and right are swapped") && error.contains("--topic /cam0/image_rect"), "{error}");
}
