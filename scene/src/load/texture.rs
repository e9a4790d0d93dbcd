//! From an image file's bytes to a [`Texture`].

use std::io::Cursor;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::{
    budget::{Borrowed, Budget},
    warnings::Warnings,
};
use crate::{ColorSpace, Result, Texture};

/// Most bytes that what is no pixel may take: compressed colour profiles in PNG files can be bombs.
const METADATA: u64 = 16 << 20;

/// A decoded image: 8-bit RGBA, row by row from the top.
pub(super) struct Pixels<'a> {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) texels: Vec<[u8; 4]>,
    held: Borrowed<'a>,
}

impl Pixels<'_> {
    /// Makes a texture of the pixels.
    pub(super) fn into_texture(self, name: &str, color_space: ColorSpace) -> Texture {
        self.held.keep();
        Texture::new(name, self.width, self.height, self.texels, color_space)
    }
}

/// Decodes an image; `name` tells the format where the bytes do not (TGA). 16-bit and grey images become 8-bit RGBA.
///
/// An image that cannot be decoded is a warning and `None`.
///
/// # Errors
/// If the budget does not allow the image.
pub(super) fn decode<'a>(
    bytes: &[u8],
    name: &str,
    budget: &'a Budget<'_>,
    warnings: &Warnings,
) -> Result<Option<Pixels<'a>>> {
    let unusable = |reason: String| {
        warnings.add(format!(
            "the image '{name}' cannot be used, white takes its place: {reason}"
        ));
        Ok(None)
    };
    let _metadata = budget.borrow("the metadata of an image", 2 * METADATA)?;
    let decoder = match decoder(bytes, name, budget) {
        Ok(decoder) => decoder,
        Err(reason) => return unusable(reason),
    };
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return unusable("it has no pixels".into());
    }
    let what = format!("the {width}×{height} image '{name}'");
    // Below, no product overflows: so many pixels are not allowed. Six bytes a pixel are what a progressive JPEG's coefficients take, more than the texels made afterwards.
    let decoding = budget.borrow(
        &what,
        decoder
            .total_bytes()
            .saturating_add(pixels.saturating_mul(6)),
    )?;
    let texels = match DynamicImage::from_decoder(decoder) {
        Ok(image) => texels(&image),
        Err(error) => {
            // Or else a file could have the same broken image decoded for every one of its materials.
            decoding.keep();
            return unusable(error.to_string());
        }
    };
    drop(decoding);
    Ok(Some(Pixels {
        width,
        height,
        texels,
        // A third more for the mip chain to come.
        held: budget.borrow(&what, pixels * 16 / 3)?,
    }))
}

fn decoder<'a>(
    bytes: &'a [u8],
    name: &str,
    budget: &Budget<'_>,
) -> Result<impl ImageDecoder + 'a, String> {
    let format = match image::guess_format(bytes) {
        Ok(format) => format,
        // A TGA file begins with nothing that could be recognised.
        Err(_) if name.to_lowercase().ends_with(".tga") => ImageFormat::Tga,
        Err(_) => return Err("it is of no known format".into()),
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let limits = |bytes: u64| {
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(bytes);
        limits
    };
    reader.limits(limits(METADATA));
    let mut decoder = reader.into_decoder().map_err(|error| error.to_string())?;
    let set = decoder.set_limits(limits(budget.left()));
    set.map_err(|error| error.to_string())?;
    Ok(decoder)
}

/// The pixels as 8-bit RGBA, without a second copy in between.
fn texels(image: &DynamicImage) -> Vec<[u8; 4]> {
    match image.color() {
        ColorType::Rgb8 => image
            .as_bytes()
            .chunks_exact(3)
            .map(|rgb| [rgb[0], rgb[1], rgb[2], 255])
            .collect(),
        ColorType::Rgba8 => image
            .as_bytes()
            .chunks_exact(4)
            .map(|rgba| [rgba[0], rgba[1], rgba[2], rgba[3]])
            .collect(),
        _ => {
            use image::GenericImageView;
            image.pixels().map(|(_, _, pixel)| pixel.0).collect()
        }
    }
}
