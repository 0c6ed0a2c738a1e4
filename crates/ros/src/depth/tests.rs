use super::*;
use crate::field::Fixed;
use proptest::prelude::*;

fn image<'a>(encoding: &'static str, size: [u32; 2], step: u32, data: &'a [u8]) -> Image<'a> {
    Image { height: size[1], width: size[0], encoding: encoding.into(), step, data, ..Default::default() }
}

#[test]
fn millimetres_and_metres_are_read_in_either_endianness_behind_padding() {
    let data = [0xe8, 3, 0, 0, 9, 9, 0xff, 0xff, 0xd0, 7];
    assert_eq!(image("16UC1", [2, 2], 6, &data).depth_m(None).unwrap(), [1.0, 0.0, 0.0, 2.0]);
    assert_eq!(image("mono16", [2, 2], 6, &data).depth_m(Some(500.0)).unwrap(), [2.0, 0.0, 0.0, 4.0]);
    let big = Image { is_bigendian: 1, ..image("16UC1", [1, 1], 2, &[3, 0xe8]) };
    assert_eq!(big.depth_m(None).unwrap(), [1.0]);
    let floats: Vec<u8> = [1.5_f32, f32::NAN].iter().flat_map(|v| v.to_le_bytes()).collect();
    let depth = image("32FC1", [2, 1], 8, &floats).depth_m(None).unwrap();
    assert!(depth[0] == 1.5 && depth[1].is_nan());
}

#[test]
fn an_image_that_contradicts_itself_is_refused() {
    let error = |image: Image<'_>| image.depth_m(None).unwrap_err().to_string();
    assert_eq!(
        error(image("16UC1", [2, 2], 4, &[0; 7])),
        "the image's data: expected 2 x 2 pixels of 2 bytes (8 bytes), found 7 bytes"
    );
    assert!(error(image("rgb8", [1, 1], 3, &[0; 3])).contains("`rgb8`"));
    assert!(error(image("32FC1", [u32::MAX, u32::MAX], u32::MAX, &[0; 8])).contains("found 8 bytes"));
    assert!(error(image("16UC1", [0, 0], 0, &[])).contains("0 bytes"));
}

#[test]
fn compressed_floats_are_inverse_depths() {
    let packed = DepthCompression { quant_a: 100.0, quant_b: -10.0, file: &[] };
    assert_eq!(packed.depth_m(DepthNumbers::Metres, &[0, 40], None), [0.0, 2.0]);
    assert_eq!(packed.depth_m(DepthNumbers::Millimetres, &[0, 2000, u16::MAX], None), [0.0, 2.0, 0.0]);
    assert_eq!(DepthNumbers::of_format("32FC1; compressedDepth png"), Some(DepthNumbers::Metres));
    assert_eq!(DepthNumbers::of_format("jpeg"), None);
}

#[test]
fn cameras_are_by_k_and_d_or_by_p() {
    let (mut k, mut p) = ([0.0; 9], [0.0; 12]);
    [k[0], k[2], k[4], k[5]] = [500.0, 320.0, 501.0, 240.0];
    [p[0], p[2], p[5], p[6]] = [480.0, 319.0, 481.0, 239.0];
    let d = [0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.0, 0.0];
    let info = CameraInfo {
        width: 640,
        height: 480,
        distortion_model: "plumb_bob".into(),
        d: d[..5].into(),
        k: Fixed(k),
        p: Fixed(p),
        ..Default::default()
    };
    let (raw, left_out) = info.pinhole().unwrap();
    assert_eq!(
        (raw.focal_px, raw.centre_px, raw.distortion, left_out),
        ([500.0, 501.0], [320.0, 240.0], [0.1, 0.2, 0.3, 0.4, 0.5], None)
    );
    let rectified = info.rectified().unwrap();
    assert_eq!((rectified.focal_px, rectified.distortion), ([480.0, 481.0], [0.0; 5]));
    assert_eq!(CameraInfo { p: Fixed([0.0; 12]), ..info.clone() }.rectified().unwrap().focal_px, raw.focal_px);
    let fisheye = CameraInfo { distortion_model: "equidistant".into(), ..info.clone() };
    assert!(fisheye.pinhole().unwrap().1.is_some_and(|left_out| left_out.0 == "`equidistant`"));
    let rational = CameraInfo { distortion_model: "rational_polynomial".into(), d: d[..].into(), ..info.clone() };
    assert_eq!(rational.pinhole().unwrap(), (raw, None));
    assert!(CameraInfo { k: Fixed([0.0; 9]), ..info }.pinhole().is_err());
}

proptest! {
    #[test]
    fn any_image(width: u32, height in 0..u32::MAX, step: u32, data: Vec<u8>, small in 0..9_u32) {
        for size in [[width, height], [small, small]] {
            for encoding in ["16UC1", "32FC1"] {
                if let Ok(depth) = image(encoding, size, step, &data).depth_m(None) {
                    prop_assert_eq!(depth.len(), size[0] as usize * size[1] as usize);
                }
            }
        }
    }
}
