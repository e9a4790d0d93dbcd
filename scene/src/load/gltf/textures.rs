//! Textures, images and samplers (glTF 2.0 §3.8).

use std::{collections::HashMap, sync::Arc};

use gltf_json::{
    Value,
    texture::{MagFilter, Sampler, Texture as JsonTexture, WrappingMode},
    validation::Checked,
};

use super::document::Document;
use crate::{ColorSpace, Filter, Result, Texture, Wrap, load::budget::Borrowed};

/// The textures that the scene uses, decoded when first asked for.
pub(super) struct Textures<'a> {
    document: &'a Document<'a>,
    index_of: HashMap<Key, Option<u32>>,
    textures: Vec<Arc<Texture>>,
}

/// What makes a texture: textures of the file that agree in it are one.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    image: usize,
    wrap: [Wrap; 2],
    filter: Filter,
    color_space: ColorSpace,
}

impl<'a> Textures<'a> {
    pub(super) fn new(document: &'a Document<'a>) -> Self {
        Self {
            document,
            index_of: HashMap::new(),
            textures: Vec::new(),
        }
    }

    /// The place in the scene of a texture of the file, or `None` where its image cannot be used.
    pub(super) fn get(&mut self, index: usize, color_space: ColorSpace) -> Result<Option<u32>> {
        let document = self.document;
        let json = document.item(&document.root.textures, "texture", index)?;
        let Some(image) = source(json) else {
            document.warn("a texture has no PNG, JPEG or WebP image; white takes its place");
            return Ok(None);
        };
        let sampler = match json.sampler {
            Some(index) => document.item(&document.root.samplers, "sampler", index.value())?,
            None => &Sampler::default(),
        };
        let key = Key {
            image,
            wrap: [wrap(sampler.wrap_s), wrap(sampler.wrap_t)],
            filter: filter(sampler),
            color_space,
        };
        if let Some(&place) = self.index_of.get(&key) {
            return Ok(place);
        }
        let place = self.load(key)?.map(|texture| {
            self.textures.push(Arc::new(texture));
            self.textures.len() as u32 - 1
        });
        self.index_of.insert(key, place);
        Ok(place)
    }

    pub(super) fn finish(self) -> Vec<Arc<Texture>> {
        self.textures
    }

    fn load(&self, key: Key) -> Result<Option<Texture>> {
        let Some((name, bytes, _held)) = self.image(key.image)? else {
            return Ok(None);
        };
        let pixels = self.document.context.pixels(&bytes, &name)?;
        Ok(pixels.map(|pixels| {
            let mut texture = pixels.into_texture(&name, key.color_space);
            texture.wrap = key.wrap;
            texture.filter = key.filter;
            texture
        }))
    }

    /// The name and bytes of an image; a missing or unusable one is a warning.
    fn image(&self, index: usize) -> Result<Option<ImageBytes<'_>>> {
        let document = self.document;
        let image = document.item(&document.root.images, "image", index)?;
        let own_name = image.name.clone().filter(|name| !name.is_empty());
        let numbered = || format!("image {index}");
        match (&image.uri, image.buffer_view) {
            (_, Some(view)) => {
                let bytes = document.view(view.value())?;
                let name = own_name.unwrap_or_else(numbered);
                Ok(Some((name, bytes.into(), None)))
            }
            (Some(uri), None) => {
                let fetched = document.fetch(&numbered(), uri);
                let Some((bytes, held)) = document.context.optional(fetched)? else {
                    return Ok(None);
                };
                let file = Some(uri.clone()).filter(|uri| !uri.starts_with("data:"));
                let name = file.or(own_name).unwrap_or_else(numbered);
                Ok(Some((name, bytes.into(), Some(held))))
            }
            (None, None) => {
                document.warn(format!(
                    "{} has neither data nor a file; white takes its place",
                    numbered()
                ));
                Ok(None)
            }
        }
    }
}

/// Name, bytes, and the memory they hold if it is their own.
type ImageBytes<'a> = (String, std::borrow::Cow<'a, [u8]>, Option<Borrowed<'a>>);

/// The image of a texture: the WebP one if there is, else the one for everybody.
fn source(json: &JsonTexture) -> Option<usize> {
    let extensions = json.extensions.as_ref();
    let webp = extensions.and_then(|all| all.others.get("EXT_texture_webp"));
    let webp = webp.and_then(|webp| webp.get("source").and_then(Value::as_u64));
    match webp {
        Some(source) => usize::try_from(source).ok(),
        None => Some(json.source.value()).filter(|&source| source != u32::MAX as usize),
    }
}

fn wrap(mode: Checked<WrappingMode>) -> Wrap {
    match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
        Checked::Valid(WrappingMode::Repeat) | Checked::Invalid => Wrap::Repeat,
    }
}

fn filter(sampler: &Sampler) -> Filter {
    match sampler.mag_filter {
        Some(Checked::Valid(MagFilter::Nearest)) => Filter::Nearest,
        _ => Filter::Linear,
    }
}
