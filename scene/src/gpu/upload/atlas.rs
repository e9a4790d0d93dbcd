//! Where every mip level of every texture lies in the layers of one array texture.

use std::sync::Arc;

use crate::{Error, Result, Texture, gpu::Context};

/// A level's rectangle in a layer, texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) x: u32,
    pub(super) y: u32,
    pub(super) layer: u32,
    pub(super) width: u32,
    pub(super) height: u32,
}

/// The packed rectangles: of every texture all levels, behind each other.
#[derive(Debug)]
pub(super) struct Atlas {
    pub(super) places: Vec<Place>,
    size: u32,
    layers: u32,
}

impl Atlas {
    /// Places all levels: the highest first, in shelves from left to right, in square layers that are just as large
    /// as needed.
    pub(super) fn pack(
        textures: &[Arc<Texture>],
        limits: &wgpu::Limits,
        adapter: impl FnOnce() -> String,
    ) -> Result<Self> {
        let mut places: Vec<Place> = textures
            .iter()
            .flat_map(|texture| (0..texture.level_count()).map(|level| texture.level(level)))
            .map(|(width, height, _)| Place {
                width,
                height,
                ..Place::default()
            })
            .collect();
        let mut order: Vec<usize> = (0..places.len()).collect();
        order.sort_by_key(|&index| std::cmp::Reverse((places[index].height, places[index].width)));
        let side = places
            .iter()
            .map(|place| place.width.max(place.height))
            .max();
        let side = side.unwrap_or(1);
        let texels: u64 = places
            .iter()
            .map(|place| u64::from(place.width) * u64::from(place.height))
            .sum();
        let largest = limits.max_texture_dimension_2d;
        let too_large = |needs: u64, limit: u64| Error::GpuLimit {
            what: "the scene's textures".into(),
            needs,
            limit,
            adapter: adapter(),
        };
        let layer_bytes = |size: u32| 4 * u64::from(size) * u64::from(size);
        if side > largest {
            return Err(too_large(layer_bytes(side), layer_bytes(largest)));
        }
        // One layer that is just large enough; several where it would be larger than 4096².
        let mut size = (texels as f64).sqrt().ceil() as u32;
        size = size.clamp(side, 4096.max(side)).min(largest);
        loop {
            let layers = shelve(&mut places, &order, size);
            let one = layers <= 1 || size >= 4096;
            if one && layers <= limits.max_texture_array_layers {
                return Ok(Self {
                    places,
                    size,
                    layers: layers.max(1),
                });
            }
            if size == largest {
                let limit = layer_bytes(largest) * u64::from(limits.max_texture_array_layers);
                return Err(too_large(4 * texels, limit));
            }
            let step = if size < 4096 { 256 } else { size };
            size = (size + step).min(largest);
        }
    }

    /// Creates the array texture and writes every level, sRGB as it is stored.
    pub(super) fn upload(&self, context: &Context, textures: &[Arc<Texture>]) -> wgpu::Texture {
        let pages = context.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("scene textures"),
            size: wgpu::Extent3d {
                width: self.size,
                height: self.size,
                depth_or_array_layers: self.layers,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let levels = textures
            .iter()
            .flat_map(|texture| (0..texture.level_count()).map(|level| texture.level(level).2));
        let mut pending = 0;
        for (place, texels) in self.places.iter().zip(levels) {
            context.queue().write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: &pages,
                    mip_level: 0,
                    origin: wgpu::Origin3d {
                        x: place.x,
                        y: place.y,
                        z: place.layer,
                    },
                    aspect: wgpu::TextureAspect::All,
                },
                bytemuck::cast_slice(texels),
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * place.width),
                    rows_per_image: Some(place.height),
                },
                wgpu::Extent3d {
                    width: place.width,
                    height: place.height,
                    depth_or_array_layers: 1,
                },
            );
            // Writes wait in staging memory until something is submitted.
            pending += texels.len();
            if pending > 1 << 24 {
                context.queue().submit([]);
                pending = 0;
            }
        }
        pages
    }

    /// Bytes of all layers.
    pub(super) fn bytes(&self) -> u64 {
        4 * u64::from(self.size) * u64::from(self.size) * u64::from(self.layers)
    }
}

/// Fills shelves with rectangles of falling height; returns the number of layers. None is wider or higher than `size`.
fn shelve(places: &mut [Place], order: &[usize], size: u32) -> u32 {
    let (mut x, mut y, mut layer, mut shelf) = (0, 0, 0, 0);
    for &index in order {
        let place = &mut places[index];
        if x + place.width > size {
            (x, y) = (0, y + shelf);
            shelf = 0;
        }
        if y + place.height > size {
            (x, y, layer, shelf) = (0, 0, layer + 1, 0);
        }
        (place.x, place.y, place.layer) = (x, y, layer);
        shelf = shelf.max(place.height);
        x += place.width;
    }
    if order.is_empty() { 0 } else { layer + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ColorSpace;

    fn textures(sizes: &[(u32, u32)]) -> Vec<Arc<Texture>> {
        let texture = |&(width, height): &(u32, u32)| {
            let texels = vec![[0; 4]; width as usize * height as usize];
            Arc::new(Texture::new("", width, height, texels, ColorSpace::Srgb))
        };
        sizes.iter().map(texture).collect()
    }

    #[test]
    fn no_two_levels_overlap() {
        let textures = textures(&[(256, 256), (1, 1), (300, 7), (17, 190), (64, 64), (64, 65)]);
        let atlas = Atlas::pack(&textures, &wgpu::Limits::default(), String::new).unwrap();
        for (index, a) in atlas.places.iter().enumerate() {
            assert!(a.x + a.width <= atlas.size && a.y + a.height <= atlas.size);
            assert!(a.layer < atlas.layers);
            for b in &atlas.places[..index] {
                let apart = a.layer != b.layer
                    || a.x + a.width <= b.x
                    || b.x + b.width <= a.x
                    || a.y + a.height <= b.y
                    || b.y + b.height <= a.y;
                assert!(apart, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn equal_textures_waste_little() {
        let textures = textures(&[(512, 512); 24]);
        let atlas = Atlas::pack(&textures, &wgpu::Limits::default(), String::new).unwrap();
        let used: u64 = atlas
            .places
            .iter()
            .map(|p| u64::from(p.width * p.height))
            .sum();
        assert!(atlas.bytes() <= 6 * used, "{} {used}", atlas.bytes());
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let limits = wgpu::Limits {
            max_texture_dimension_2d: 64,
            max_texture_array_layers: 2,
            ..wgpu::Limits::default()
        };
        for sizes in [&[(65, 1)][..], &[(64, 64); 3][..]] {
            let error = Atlas::pack(&textures(sizes), &limits, || "tiny".into()).unwrap_err();
            assert!(error.to_string().contains("tiny"), "{error}");
        }
    }
}
