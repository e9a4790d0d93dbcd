//! Images of named float channels, as OpenEXR keeps them.
//!
//! [`Image::save`] writes what is calculated with (EXR) or looked at (PNG), [`Image::load`] reads both.

mod display;
#[cfg(feature = "exr")]
mod exr;

use std::{collections::BTreeMap, path::Path};

use ::image::ImageFormat;
use glam::Vec3;

use crate::{Error, Result};

/// Most pixels on a side of an image.
const MAX_SIDE: u32 = 16_384;
/// Most bytes of float samples in an image.
const MAX_BYTES: u64 = 8 << 30;

/// A float image: channels named as in OpenEXR, and the settings it was made with.
///
/// The picture is in `R`, `G`, `B`; further layers are `layer.channel`, for example `normal.X` or `indirect.R`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows, the first at the top.
    pub height: u32,
    /// The channels, in the order they were added.
    pub channels: Vec<Channel>,
    /// Header texts: settings, noise, device.
    pub attributes: BTreeMap<String, String>,
}

/// One number per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// `R`, or `layer.R`.
    pub name: String,
    /// Row by row from the top.
    pub samples: Vec<f32>,
}

impl Image {
    /// Most pixels on a side of an image that can be loaded.
    pub const MAX_SIDE: u32 = MAX_SIDE;
    /// Most bytes of float samples, over all channels, of an image that can be loaded.
    pub const MAX_BYTES: u64 = MAX_BYTES;

    /// An image without channels.
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            ..Self::default()
        }
    }

    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Adds a channel.
    ///
    /// # Panics
    /// If there is not one sample per pixel.
    pub fn push(&mut self, name: impl Into<String>, samples: Vec<f32>) {
        assert_eq!(samples.len(), self.pixel_count(), "one sample per pixel");
        self.channels.push(Channel {
            name: name.into(),
            samples,
        });
    }

    /// Adds three channels with the given last letters, for example `"RGB"` or `"XYZ"`, to a layer; the layer `""` is the picture.
    pub fn push_layer(&mut self, layer: &str, letters: &str, values: &[Vec3]) {
        for (axis, letter) in letters.chars().take(3).enumerate() {
            self.push(
                channel_name(layer, letter),
                values.iter().map(|value| value[axis]).collect(),
            );
        }
    }

    /// The samples of a channel.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels
            .iter()
            .find(|channel| channel.name == name)
            .map(|channel| &channel.samples[..])
    }

    /// The R, G and B of a layer (`""` is the picture) as one vector per pixel, where it has all three.
    pub fn rgb(&self, layer: &str) -> Option<Vec<Vec3>> {
        let [r, g, b] = ['R', 'G', 'B'].map(|letter| self.channel(&channel_name(layer, letter)));
        let (r, g, b) = (r?, g?, b?);
        Some(
            (0..self.pixel_count())
                .map(|i| Vec3::new(r[i], g[i], b[i]))
                .collect(),
        )
    }
}

impl Image {
    /// Reads OpenEXR (any pixel type, all parts and layers), Radiance HDR, PNG and other 8-bit formats, chosen by
    /// the file's suffix. 8- and 16-bit values are taken as sRGB and linearised; every EXR text is an attribute.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Malformed`] for files that are cut, empty or lie about themselves,
    /// [`Error::UnknownFormat`], [`Error::Unsupported`] for deep or subsampled EXR, and [`Error::TooLarge`] beyond
    /// [`MAX_SIDE`](Self::MAX_SIDE) or [`MAX_BYTES`](Self::MAX_BYTES).
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        match suffix(path).as_str() {
            #[cfg(feature = "exr")]
            "exr" => exr::load(path),
            suffix => match ImageFormat::from_extension(suffix) {
                Some(format) if format.reading_enabled() => display::load(path, format),
                _ => Err(Error::UnknownFormat {
                    path: path.to_owned(),
                    known: ".exr, .hdr, .png and .jpg",
                }),
            },
        }
    }

    /// Writes an EXR file (one part, 32-bit floats, all channels and attributes) or a PNG file
    /// ([`save_png`](Self::save_png) at exposure 0), chosen by the file's suffix. The file appears whole or not at all.
    ///
    /// Attributes with a name that OpenEXR has a meaning of its own for (`comments`, `owner`, …) are an error.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::UnknownFormat`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        match suffix(path).as_str() {
            #[cfg(feature = "exr")]
            "exr" => exr::save(self, path),
            "png" => self.save_png(path, 0.0),
            _ => Err(Error::UnknownFormat {
                path: path.to_owned(),
                known: ".exr and .png",
            }),
        }
    }

    /// Writes the picture for looking at: R, G, B times 2^`exposure` as 8-bit sRGB. Attributes become text chunks,
    /// and so does the exposure.
    ///
    /// # Errors
    /// [`Error::Io`], and [`Error::Parameter`] when there are no channels `R`, `G`, `B`.
    pub fn save_png(&self, path: impl AsRef<Path>, exposure: f32) -> Result<()> {
        display::save(self, path.as_ref(), exposure)
    }
}

fn suffix(path: &Path) -> String {
    path.extension()
        .and_then(|suffix| suffix.to_str())
        .unwrap_or_default()
        .to_ascii_lowercase()
}

fn check_size(path: &Path, width: u64, height: u64) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(Error::malformed(path, "has no pixels"));
    }
    if width.max(height) > u64::from(MAX_SIDE) {
        let reason = format!("{width}×{height} pixels; at most {MAX_SIDE} on a side are read");
        return Err(Error::malformed(path, reason));
    }
    Ok(())
}

fn channel_name(layer: &str, letter: char) -> String {
    if layer.is_empty() {
        letter.to_string()
    } else {
        format!("{layer}.{letter}")
    }
}
