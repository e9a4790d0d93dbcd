//! Images of named float channels, as OpenEXR keeps them.

use std::collections::BTreeMap;

use glam::Vec3;

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

fn channel_name(layer: &str, letter: char) -> String {
    if layer.is_empty() {
        letter.to_string()
    } else {
        format!("{layer}.{letter}")
    }
}
