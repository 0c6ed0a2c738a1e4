//! Images of depth: units, sizes, encodings.

use super::*;

/// Images of 16 x 12 pixels of one encoding, of the same depth everywhere, and a camera of some size beside them.
fn images(name: &str, encoding: &'static str, pixel: &[u8], info: (&str, [u32; 2])) -> PathBuf {
    let mut recorder = Recorder::new(name);
    if !info.0.is_empty() {
        recorder.camera(info.0, info.1);
    }
    for k in 0..3 {
        let image = Image {
            header: Header::new(ms(100 * k), "camera"),
            width: 16,
            height: 12,
            encoding: encoding.into(),
            step: 16 * pixel.len() as u32,
            data: &pixel.repeat(192),
            ..Default::default()
        };
        recorder.write("/device_0/sensor_0/Depth_0/depth", IMAGE, ms(100 * k), &image);
    }
    recorder.finish()
}

const BESIDE: &str = "/device_0/sensor_0/Depth_0/camera_info";

#[test]
fn depth_in_another_unit_is_taken_for_what_it_can_only_be_or_named() {
    let path = images("mm.mcap", "32FC1", &2000.0_f32.to_le_bytes(), (BESIDE, [16, 12]));
    let (clouds, _, plan) = read(&path);
    assert_eq!(clouds[0].points_m[20][2], 2.0);
    assert!(plan.assumed.iter().any(|words| words.contains("taken for millimetres; `--depth-scale 1`")), "{plan:?}");
    let unit = Choice { range_unit_m: Some(0.001), ..Choice::default() };
    let error = SpacePlan::of(&Survey::of(&path).unwrap(), &unit, &CameraOptions::default()).unwrap_err();
    assert!(error.contains("--depth-scale S"), "{error}");
    let tenths = images("tenths.mcap", "Z16", &20_000_u16.to_le_bytes(), (BESIDE, [16, 12]));
    let (clouds, _, plan) = read(&tenths);
    assert_eq!(clouds[0].points_m[20][2], 20.0);
    assert!(
        plan.odd[0].contains("depths at 20.0 to 20.0 m") && plan.odd[0].contains("--depth-scale 10000"),
        "{plan:?}"
    );
    let scale = CameraOptions { depth_scale: Some(10_000.0), ..CameraOptions::default() };
    let (clouds, _, plan) = read_with(&tenths, &Choice::default(), &scale);
    assert!((clouds[0].points_m[20][2] - 2.0).abs() < 1e-6 && plan.odd.is_empty(), "{plan:?}");
}

#[test]
fn a_camera_of_another_size_is_scaled_or_asked_for_and_one_that_looks_aside_is_doubted() {
    let depth = 2000_u16.to_le_bytes();
    let reason = |plan: &SpacePlan| plan.reasons.iter().find(|(what, _)| *what == "camera").unwrap().1.clone();
    // the camera of 4 x 3 pixels has its axis in the middle
    let (clouds, _, plan) = read(&images("scaled.mcap", "16UC1", &depth, (BESIDE, [4, 3])));
    assert!(
        reason(&plan).contains("16 x 12, fx 16.0, fy 16.0, scaled from 4 x 3") && plan.doubts.is_empty(),
        "{plan:?}"
    );
    assert_eq!(clouds[0].points_m[0][0], -0.9375);
    let error = plan_of("shape.mcap", &depth, [16, 9]).unwrap_err();
    assert!(error.contains("images of 16 x 12 pixels") && error.contains("--intrinsics FX,FY,CX,CY"), "{error}");
    let aside = plan_of("aside.mcap", &depth, [16, 12]).unwrap();
    assert!(aside.doubts[0].contains("at the edge of the image (1.5, 1.0 of 16 x 12 pixels)"), "{aside:?}");
}

fn plan_of(name: &str, depth: &[u8], size: [u32; 2]) -> Result<SpacePlan, String> {
    plan(&images(name, "16UC1", depth, (BESIDE, size)), &CameraOptions::default())
}

#[test]
fn the_only_camera_of_the_images_size_is_theirs_and_a_realsense_says_its_unit() {
    let depth = 20_000_u16.to_le_bytes();
    let path = images("only.mcap", "mono16", &depth, ("/elsewhere/info", [16, 12]));
    let plan = plan(&path, &CameraOptions::default()).unwrap();
    assert!(plan.assumed.iter().any(|words| words.contains("the only CameraInfo of its size")), "{plan:?}");
    let mut recorder = Recorder::new("units_option.mcap");
    recorder.camera("/device_0/sensor_0/Depth_0/info/camera_info", [4, 3]);
    recorder.depth("/device_0/sensor_0/Depth_0/image/data", 0, [4, 3], &depth.repeat(12));
    let mut number = vec![0, 1, 0, 0];
    number.extend(0.0001_f32.to_le_bytes());
    recorder.raw("/device_0/sensor_0/option/Depth_Units/value", "std_msgs/msg/Float32", ms(0), &number);
    let (clouds, _, found) = read(&recorder.finish());
    let reason = &found.reasons.iter().find(|(what, _)| *what == "camera").unwrap().1;
    assert!((clouds[0].points_m[5][2] - 2.0).abs() < 1e-6, "{:?}", clouds[0]);
    assert!(reason.contains("10000 a metre by /device_0/sensor_0/option/Depth_Units/value"), "{reason}");
}

#[test]
fn encodings_that_are_not_read_are_named_with_those_that_are() {
    let path = images("bytes.mcap", "8UC1", &[7], (BESIDE, [16, 12]));
    let survey = Survey::of(&path).unwrap();
    let error = mapwright_logs::Plan::of(&survey, &Choice::default()).unwrap_err();
    let said = "images of 16 x 12 as `8UC1`: images are mapped that have depth as 16UC1, mono16, Z16 or 32FC1";
    assert!(error.contains(said), "{error}");
    assert!(plan(&path, &CameraOptions::default()).unwrap_err().contains(said));
}

#[test]
fn compressed_depth_is_read_with_its_header_and_as_plain_png() {
    for (format, number, prefix, depth_m) in [
        ("16UC1; compressedDepth png", 2000, Some([0.0, 0.0]), 2.0),
        ("32FC1; compressedDepth png", 40, Some([100.0, -10.0]), 2.0),
        ("16UC1; png compressed ", 2000, None, 2.0),
    ] {
        let mut recorder = Recorder::new("compressed.mcap");
        recorder.camera("/cam/camera_info", [4, 3]);
        let mut data = prefix.map_or_else(Vec::new, |[a, b]: [f32; 2]| floats(&[0.0, a, b]));
        data.extend(png(number));
        let torn = data[..data.len() - 30].to_vec();
        for data in [&data, &torn] {
            let header = Header::new(ms(0), "optical");
            let image = CompressedImage { header, format: format.into(), data };
            recorder.write("/cam/image/compressedDepth", "sensor_msgs/msg/CompressedImage", ms(0), &image);
        }
        let (clouds, notes, _) = read(&recorder.finish());
        assert_eq!((clouds.len(), clouds[0].points_m[5][2]), (1, depth_m), "{format}");
        assert_eq!(notes.count(NoteKind::UnreadableFrame), 1, "{format}");
    }
}
