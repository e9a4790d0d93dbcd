//! PNG for looking at, and the other 8-bit and HDR formats as input.

use std::{
    fs::File,
    io::{BufReader, BufWriter},
    path::Path,
};

use ::image::{ImageDecoder, ImageFormat, ImageReader, Limits};
use glam::Vec3;

use super::{Image, MAX_SIDE, check_size};
use crate::{Error, Result, linear_to_srgb, output::write_atomically, srgb_to_linear};

/// What the decoders of 8- and 16-bit formats may allocate: enough for three bytes of every pixel of the largest image.
const MAX_ALLOC: u64 = 1 << 30;

/// Writes R, G, B as 8-bit sRGB after multiplication with 2^`exposure`.
pub(super) fn save(image: &Image, path: &Path, exposure: f32) -> Result<()> {
    let Some(pixels) = image.rgb("") else {
        return Err(Error::Parameter {
            name: "the image",
            value: "without channels R, G, B".into(),
            expected: "a PNG shows these",
        });
    };
    let factor = exposure.exp2();
    let mut bytes = Vec::with_capacity(3 * pixels.len());
    for pixel in pixels {
        bytes.extend((pixel * factor).to_array().map(display_byte));
    }
    let said = format!("{exposure} stops: linear values times {factor}, then sRGB");
    write_atomically(path, |writer| {
        encode(writer, image, &bytes, said).map_err(|error| match error {
            png::EncodingError::IoError(error) => Error::io(path, error),
            error => Error::malformed(path, error.to_string()),
        })
    })
}

fn encode(
    writer: &mut BufWriter<&mut File>,
    image: &Image,
    bytes: &[u8],
    exposure: String,
) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(writer, image.width, image.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    encoder.add_text_chunk("exposure".into(), exposure)?;
    for (name, value) in image
        .attributes
        .iter()
        .filter(|(name, _)| *name != "exposure")
    {
        // tEXt is Latin-1 only and a keyword has at most 79 letters; iTXt takes any text.
        if value.is_ascii() {
            encoder.add_text_chunk(name.clone(), value.clone())?;
        } else {
            encoder.add_itxt_chunk(name.clone(), value.clone())?;
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()
}

/// The 8-bit sRGB value of a linear one; NaN is black.
fn display_byte(linear: f32) -> u8 {
    (linear_to_srgb(linear.clamp(0.0, 1.0)) * 255.0).round() as u8
}

/// Reads what the `image` crate reads: HDR as linear floats, 8 and 16 bits as sRGB.
pub(super) fn load(path: &Path, format: ImageFormat) -> Result<Image> {
    let file = File::open(path).map_err(|error| Error::io(path, error))?;
    let metadata = file.metadata().map_err(|error| Error::io(path, error))?;
    if metadata.len() == 0 {
        return Err(Error::malformed(path, "is empty"));
    }
    let unreadable = |error: ::image::ImageError| {
        Error::malformed(path, format!("not a readable image: {error}"))
    };
    let mut reader = ImageReader::with_format(BufReader::new(file), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_ALLOC);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(unreadable)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into())?;
    let linear = decoder.color_type() == ::image::ColorType::Rgb32F;
    let pixels = ::image::DynamicImage::from_decoder(decoder)
        .map_err(unreadable)?
        .into_rgb32f();
    let values: Vec<Vec3> = pixels
        .pixels()
        .map(|pixel| Vec3::from(pixel.0))
        .map(|pixel| {
            if linear {
                pixel
            } else {
                Vec3::from(pixel.to_array().map(srgb_to_linear))
            }
        })
        .collect();
    let mut image = Image::new(width, height);
    image.push_layer("", "RGB", &values);
    Ok(image)
}
