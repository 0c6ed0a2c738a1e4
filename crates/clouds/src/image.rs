//! Images of depth and colour.

use crate::error::CloudError;
use crate::pnm::{Pnm, is_pnm};
use mapwright_stereo::{GreyImage, StereoError};
use png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};
use std::io::Cursor;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Deflate makes at most so many bytes of one.
const DEFLATE_RATIO_MAX: usize = 1032;
/// No camera has more pixels across or down.
pub(crate) const SIDE_MAX: u32 = 16_384;
/// How a PNG begins.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Depth of a pixel that saw nothing, besides 0: the largest number of 16 bits.
const NOTHING: u16 = u16::MAX;

/// A PNG whose header was read.
type PngReader<'a> = Reader<Cursor<&'a [u8]>>;

/// A JPEG whose head was read.
type JpegReader<'a> = JpegDecoder<ZCursor<&'a [u8]>>;

/// Pixels across and down.
pub(crate) type Size = [u32; 2];

/// The size of an image of depth.
pub(crate) fn depth_size(file: &str, bytes: &[u8]) -> Result<Size, CloudError> {
    open_depth(file, bytes).map(|(_, size)| size)
}

/// Depth of all pixels, metres, row by row; 0 where there is none.
pub(crate) fn read_depth(file: &str, bytes: &[u8], size: Size, depth_per_m: f64) -> Result<Vec<f32>, CloudError> {
    let (mut reader, found) = open_depth(file, bytes)?;
    if found != size {
        return Err(wrong_size(file, size, found));
    }
    let pixels = decode(file, &mut reader)?;
    let scale = (1.0 / depth_per_m) as f32;
    let metres = |pixel: &[u8]| match u16::from_be_bytes([pixel[0], pixel[1]]) {
        NOTHING => 0.0,
        depth => f32::from(depth) * scale,
    };
    Ok(pixels.chunks_exact(2).map(metres).collect())
}

/// The numbers of a greyscale PNG of 16 bits, row by row, and its pixels across and down; `file` is its name in errors.
///
/// # Errors
/// [`CloudError::Content`] where it is anything else, damaged, of more pixels than `pixels_most` or than its bytes can hold.
pub fn read_png16(file: &str, bytes: &[u8], pixels_most: u64) -> Result<([u32; 2], Vec<u16>), CloudError> {
    let (mut reader, size) = open_depth(file, bytes)?;
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    if pixels > pixels_most {
        return Err(CloudError::content(file, 16, format!("at most {pixels_most} pixels"), pixels.to_string()));
    }
    let pixels = decode(file, &mut reader)?;
    Ok((size, pixels.chunks_exact(2).map(|pixel| u16::from_be_bytes([pixel[0], pixel[1]])).collect()))
}

fn open_depth<'a>(file: &str, bytes: &'a [u8]) -> Result<(PngReader<'a>, Size), CloudError> {
    let reader = open(file, bytes, Transformations::IDENTITY)?;
    let info = reader.info();
    let is_depth = info.color_type == ColorType::Grayscale && info.bit_depth == BitDepth::Sixteen;
    let size = [info.width, info.height];
    if !is_depth {
        let found = format!("{:?} of {} bits", info.color_type, info.bit_depth as u8);
        return Err(CloudError::content(file, 24, "depth as greyscale of 16 bits", found));
    }
    Ok((reader, size))
}

/// Opens a PNG whose size its bytes may really have.
fn open<'a>(file: &str, bytes: &'a [u8], transformations: Transformations) -> Result<PngReader<'a>, CloudError> {
    let most = bytes.len().saturating_mul(DEFLATE_RATIO_MAX);
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: most.max(1 << 16) });
    decoder.set_transformations(transformations);
    let reader = decoder.read_info().map_err(|cause| CloudError::content(file, 0, "a PNG image", cause.to_string()))?;
    let info = reader.info();
    let sides_fit = info.width <= SIDE_MAX && info.height <= SIDE_MAX;
    // what transformations make of it is bounded by the camera's size, which is looked at before room is made
    if !sides_fit || info.raw_bytes() > most {
        let found = format!("{} x {} in a file of {} bytes", info.width, info.height, bytes.len());
        return Err(CloudError::content(file, 16, "a size that the file can hold", found));
    }
    Ok(reader)
}

fn decode(file: &str, reader: &mut PngReader<'_>) -> Result<Vec<u8>, CloudError> {
    let size = reader.output_buffer_size().unwrap_or(0);
    let mut pixels = vec![0; size];
    match reader.next_frame(&mut pixels) {
        Ok(_) => Ok(pixels),
        Err(cause) => Err(CloudError::content(file, 33, format!("an image of {size} bytes"), cause.to_string())),
    }
}

fn wrong_size(file: &str, size: Size, found: Size) -> CloudError {
    let [expected, found] = [size, found].map(|[width, height]| format!("{width} x {height} pixels"));
    CloudError::content(file, 16, expected, found)
}

/// Red, green and blue of all pixels of a PNG or JPEG image of the given size.
pub(crate) fn read_colours(file: &str, bytes: &[u8], size: Size) -> Result<Vec<[u8; 3]>, CloudError> {
    if bytes.starts_with(&[0xff, 0xd8]) { read_jpeg(file, bytes, size) } else { read_png(file, bytes, size) }
}

fn read_png(file: &str, bytes: &[u8], size: Size) -> Result<Vec<[u8; 3]>, CloudError> {
    let mut reader = open(file, bytes, Transformations::normalize_to_color8())?;
    let found = [reader.info().width, reader.info().height];
    if found != size {
        return Err(wrong_size(file, size, found));
    }
    let (kind, _) = reader.output_color_type();
    let pixels = decode(file, &mut reader)?;
    Ok(match kind {
        ColorType::Rgb => pixels.as_chunks::<3>().0.to_vec(),
        ColorType::Rgba => pixels.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect(),
        ColorType::GrayscaleAlpha => pixels.chunks_exact(2).map(|p| [p[0]; 3]).collect(),
        _ => pixels.iter().map(|grey| [*grey; 3]).collect(),
    })
}

/// A JPEG whose head was read, and its size.
fn jpeg_decoder<'a>(file: &str, bytes: &'a [u8]) -> Result<(JpegReader<'a>, Size), CloudError> {
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB).set_strict_mode(false);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|cause| CloudError::content(file, 0, "a JPEG image", cause.to_string()))?;
    let size = decoder.info().map_or([0, 0], |info| [u32::from(info.width), u32::from(info.height)]);
    Ok((decoder, size))
}

fn read_jpeg(file: &str, bytes: &[u8], size: Size) -> Result<Vec<[u8; 3]>, CloudError> {
    let fail = |cause: String| CloudError::content(file, 0, "a JPEG image", cause);
    // the size is looked at before room is made for the pixels
    let (mut decoder, found) = jpeg_decoder(file, bytes)?;
    if found != size {
        return Err(wrong_size(file, size, found));
    }
    let pixels = decoder.decode().map_err(|cause| fail(cause.to_string()))?;
    let colours = pixels.as_chunks::<3>().0.to_vec();
    if colours.len() != size[0] as usize * size[1] as usize {
        return Err(fail(format!("{} bytes of pixels", pixels.len())));
    }
    Ok(colours)
}

/// An image that a camera took: its grey values, and its colours where it has such.
#[derive(Debug, Default)]
pub struct CameraImage {
    /// Grey values of 8 or 16 bits.
    pub grey: GreyImage,
    /// Red, green and blue of each pixel; of grey images that value three times.
    pub colours: Vec<[u8; 3]>,
}

/// The size of an image that a camera took.
pub(crate) fn camera_image_size(file: &str, bytes: &[u8]) -> Result<Size, CloudError> {
    if bytes.starts_with(&[0xff, 0xd8]) {
        return jpeg_decoder(file, bytes).map(|(_, size)| size);
    }
    if is_pnm(bytes) {
        return Pnm::open(file, bytes, SIDE_MAX).map(|image| image.size);
    }
    if !bytes.starts_with(PNG) {
        let found = match bytes {
            [] => "an empty file".to_owned(),
            _ => format!("a file that begins with {}", bytes[..bytes.len().min(PNG.len())].escape_ascii()),
        };
        return Err(CloudError::content(file, 0, "a PNG, JPEG, PGM or PPM image", found));
    }
    let reader = open(file, bytes, Transformations::EXPAND)?;
    Ok([reader.info().width, reader.info().height])
}

/// Reads a PNG, JPEG, binary PGM or PPM image of grey values or colours; of that size, or where none is given of any that has at most
/// `pixels_most` pixels. `file` is its name in errors.
///
/// # Errors
/// [`CloudError::Content`] where it is anything else, damaged, of another size, or of more pixels than its bytes can hold.
pub fn read_camera_image(
    file: &str,
    bytes: &[u8],
    expected: Option<[u32; 2]>,
    pixels_most: u64,
) -> Result<CameraImage, CloudError> {
    let size = camera_image_size(file, bytes)?;
    if let Some(expected) = expected.filter(|expected| *expected != size) {
        return Err(wrong_size(file, expected, size));
    }
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    if pixels > pixels_most {
        return Err(CloudError::content(file, 16, format!("at most {pixels_most} pixels"), pixels.to_string()));
    }
    let mut grey = GreyImage::default();
    let [width, height] = size;
    let (set, colours) = if bytes.starts_with(&[0xff, 0xd8]) {
        let colours = read_jpeg(file, bytes, size)?;
        (grey.set_rgb8(width, height, &colours), colours)
    } else if is_pnm(bytes) {
        pnm_shades(&Pnm::open(file, bytes, SIDE_MAX)?, &mut grey)
    } else {
        png_shades(file, bytes, &mut grey)?
    };
    set.map_err(|cause| CloudError::content(file, 16, "pixels of an image", cause.to_string()))?;
    Ok(CameraImage { grey, colours })
}

/// What is wrong with the size of an image, if anything, and its colours.
type Shades = (Result<(), StereoError>, Vec<[u8; 3]>);

/// Grey values and colours of a PNG of any kind: palettes are looked up, few bits spread over eight, alpha is left out; of colours of 16 bits
/// the upper byte counts.
fn png_shades(file: &str, bytes: &[u8], grey: &mut GreyImage) -> Result<Shades, CloudError> {
    let mut reader = open(file, bytes, Transformations::EXPAND)?;
    let (width, height) = (reader.info().width, reader.info().height);
    let (kind, depth) = reader.output_color_type();
    let pixels = decode(file, &mut reader)?;
    let samples = kind.samples();
    let byte_count = if depth == BitDepth::Sixteen { 2 } else { 1 };
    if kind == ColorType::Grayscale && byte_count == 1 {
        let set = grey.set_grey8(width, height, &pixels);
        return Ok((set, pixels.iter().map(|value| [*value; 3]).collect()));
    }
    let of_pixel = pixels.chunks_exact(samples * byte_count);
    if samples < 3 {
        let value = |pixel: &[u8]| match *pixel {
            [high, low, ..] if byte_count == 2 => u16::from_be_bytes([high, low]),
            [value, ..] => u16::from(value),
            [] => 0,
        };
        let values: Vec<u16> = of_pixel.clone().map(value).collect();
        let colours = of_pixel.map(|pixel| [pixel.first().copied().unwrap_or(0); 3]).collect();
        return Ok((grey.set_grey16(width, height, &values), colours));
    }
    let colour = |pixel: &[u8]| [0, 1, 2].map(|k| pixel.get(k * byte_count).copied().unwrap_or(0));
    let colours: Vec<[u8; 3]> = of_pixel.map(colour).collect();
    Ok((grey.set_rgb8(width, height, &colours), colours))
}

/// Grey values as they are, and colours in 8 bits.
fn pnm_shades(image: &Pnm<'_>, grey: &mut GreyImage) -> Shades {
    let ([width, height], values) = (image.size, image.values());
    if image.samples == 1 {
        let set = grey.set_grey16(width, height, &values);
        return (set, values.iter().map(|value| [image.byte(*value); 3]).collect());
    }
    let colours: Vec<[u8; 3]> = values.as_chunks::<3>().0.iter().map(|of| of.map(|value| image.byte(value))).collect();
    (grey.set_rgb8(width, height, &colours), colours)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn png(size: Size, kind: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, size[0], size[1]);
        encoder.set_color(kind);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(data).unwrap();
        writer.finish().unwrap();
        file
    }

    #[test]
    fn depth_is_read_and_what_is_none_refused() {
        let data: Vec<u8> = [0_u16, 1000, u16::MAX, 2500].iter().flat_map(|d| d.to_be_bytes()).collect();
        let file = png([2, 2], ColorType::Grayscale, BitDepth::Sixteen, &data);
        assert_eq!(read_depth("d.png", &file, [2, 2], 1000.0).unwrap(), [0.0, 1.0, 0.0, 2.5]);
        let error = read_depth("d.png", &file, [3, 2], 1000.0).unwrap_err().to_string();
        assert_eq!(error, "d.png, byte 16: expected 3 x 2 pixels, found 2 x 2 pixels");
        let grey = png([2, 2], ColorType::Grayscale, BitDepth::Eight, &[1, 2, 3, 4]);
        let error = depth_size("d.png", &grey).unwrap_err().to_string();
        assert_eq!(error, "d.png, byte 24: expected depth as greyscale of 16 bits, found Grayscale of 8 bits");
        assert!(read_depth("d.png", &file[..file.len() - 20], [2, 2], 1000.0).is_err());
    }

    #[test]
    fn sizes_that_no_file_holds_are_refused() {
        let data: Vec<u8> = vec![0; 8];
        let mut file = png([2, 2], ColorType::Grayscale, BitDepth::Sixteen, &data);
        file[16..24].copy_from_slice(&[0, 0, 0x3f, 0xff, 0, 0, 0x3f, 0xff]);
        let crc = crc32(&file[12..29]);
        file[29..33].copy_from_slice(&crc.to_be_bytes());
        let error = depth_size("d.png", &file).unwrap_err().to_string();
        assert!(error.contains("a size that the file can hold"), "{error}");
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
        })
    }

    #[test]
    fn colours_of_any_kind() {
        for (kind, data, expected) in [
            (ColorType::Rgb, &[1, 2, 3, 4, 5, 6][..], [[1, 2, 3], [4, 5, 6]]),
            (ColorType::Rgba, &[1, 2, 3, 9, 4, 5, 6, 9], [[1, 2, 3], [4, 5, 6]]),
            (ColorType::Grayscale, &[7, 8], [[7; 3], [8; 3]]),
            (ColorType::GrayscaleAlpha, &[7, 0, 8, 0], [[7; 3], [8; 3]]),
        ] {
            let file = png([2, 1], kind, BitDepth::Eight, data);
            assert_eq!(read_colours("c.png", &file, [2, 1]).unwrap(), expected);
        }
        assert!(read_colours("c.jpg", &[0xff, 0xd8, 0xff], [2, 1]).is_err());
    }

    #[test]
    fn images_of_cameras_of_any_kind() {
        for (kind, depth, data, grey) in [
            (ColorType::Grayscale, BitDepth::Eight, &[7, 8][..], [7, 8]),
            (ColorType::Grayscale, BitDepth::Sixteen, &[1, 2, 0, 9], [258, 9]),
            (ColorType::Grayscale, BitDepth::One, &[0b0100_0000], [0, 255]),
            (ColorType::GrayscaleAlpha, BitDepth::Eight, &[7, 0, 8, 0], [7, 8]),
            (ColorType::Rgb, BitDepth::Eight, &[255, 255, 255, 0, 0, 0], [65_280, 0]),
            (ColorType::Rgba, BitDepth::Sixteen, &[255, 1, 255, 1, 255, 1, 0, 0, 0, 9, 0, 9, 0, 9, 0, 0], [65_280, 0]),
        ] {
            let file = png([2, 1], kind, depth, data);
            let image = read_camera_image("c.png", &file, Some([2, 1]), 9).unwrap();
            assert_eq!((image.grey.pixels(), image.colours.len()), (&grey[..], 2), "{kind:?} {depth:?}");
        }
        for (file, grey, colours) in [
            (&b"P5 2 1 255 \x07\x08"[..], [7, 8], [[7; 3], [8; 3]]),
            (b"P5 2 1 65535 \x01\x02\xff\xff", [258, 65_535], [[1; 3], [255; 3]]),
            (b"P6 2 1 255 \xff\xff\xff\0\0\0", [65_280, 0], [[255; 3], [0; 3]]),
            (b"P6 2 1 1023 \x03\xff\x03\xff\x03\xff\0\0\0\0\0\0", [65_280, 0], [[255; 3], [0; 3]]),
        ] {
            let image = read_camera_image("c.ppm", file, Some([2, 1]), 9).unwrap();
            assert_eq!((image.grey.pixels(), &image.colours[..]), (&grey[..], &colours[..]));
        }
        let file = png([2, 1], ColorType::Grayscale, BitDepth::Eight, &[7, 8]);
        let told = |size, most| read_camera_image("c.png", &file, size, most).unwrap_err().to_string();
        assert_eq!(told(Some([3, 1]), 9), "c.png, byte 16: expected 3 x 1 pixels, found 2 x 1 pixels");
        assert_eq!(told(None, 1), "c.png, byte 16: expected at most 1 pixels, found 2");
        assert!(
            read_camera_image("c.png", &file[..50], None, 9).unwrap_err().to_string().contains("an image of 2 bytes")
        );
        assert!(read_camera_image("c.jpg", &[0xff, 0xd8, 0xff], None, 9).is_err());
    }

    proptest! {
        #[test]
        fn any_portable_map(kind in 0_u8..9, head in "[ 0-9#\n]{0,20}", pixels: Vec<u8>) {
            let file = [&[b'P', b'0' + kind], head.as_bytes(), &pixels].concat();
            if let Ok(image) = read_camera_image("d", &file, None, 1 << 20) {
                prop_assert_eq!(image.grey.pixels().len(), image.colours.len());
            }
        }

        #[test]
        fn any_bytes(mut bytes: Vec<u8>, cut in 0..90_usize, at in 0..90_usize, byte: u8) {
            let _ = read_colours("c", &bytes, [4, 4]);
            bytes.splice(0..0, [0xff, 0xd8, 0xff]);
            let _ = read_colours("c", &bytes, [4, 4]);
            let mut file = png([4, 4], ColorType::Grayscale, BitDepth::Sixteen, &[5; 32]);
            let at = at.min(file.len() - 1);
            file[at] = byte;
            file.truncate(file.len() - cut.min(file.len()));
            let _ = read_depth("d", &file, [4, 4], 1000.0);
            let _ = read_png16("d", &file, 1 << 20);
            let _ = read_colours("d", &file, [4, 4]);
            let _ = read_camera_image("d", &file, None, 1 << 20);
            let _ = read_camera_image("d", &bytes, None, 1 << 20);
        }
    }
}
