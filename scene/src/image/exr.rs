//! OpenEXR: written as one part of 32-bit floats, read whatever the pixel type, with all its parts.

use std::{
    fs::File,
    io::{BufReader, Read, Seek, SeekFrom, Write},
    path::Path,
};

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatImage, FlatSamples,
    IntegerBounds, Layer, LayerAttributes, LineOrder, MetaData, ReadChannels, ReadLayers, Text,
    Vec2, WritableImage, read,
};

use super::{Channel, Image, MAX_BYTES, check_size};
use crate::{Error, Result, output::write_atomically};

/// Deflate, the best packer of the format's codecs, makes at most 1032 bytes of one.
const MAX_RATIO: u64 = 1100;

pub(super) fn save(image: &Image, path: &Path) -> Result<()> {
    let size = Vec2(image.width as usize, image.height as usize);
    let channels = image
        .channels
        .iter()
        .map(|channel| {
            AnyChannel::new(
                text(&channel.name),
                FlatSamples::F32(channel.samples.clone()),
            )
        })
        .collect();
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        // Any other order depends on which thread is done first.
        line_order: LineOrder::Increasing,
    };
    let mut attributes = LayerAttributes::default();
    for (name, value) in &image.attributes {
        attributes
            .other
            .insert(text(name), AttributeValue::Text(text(value)));
    }
    let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(channels));
    write_atomically(path, |writer| {
        exr::prelude::Image::from_layer(layer)
            .write()
            .to_buffered(&mut *writer)
            .map_err(|error| match error {
                exr::error::Error::Io(error) => Error::io(path, error),
                error => Error::malformed(path, format!("cannot be written as OpenEXR: {error}")),
            })?;
        writer
            .flush()
            .and_then(|()| sort_attributes(writer.get_mut()))
            .map_err(|error| Error::io(path, error))
    })
}

/// Puts the header's attributes in order of their names. The `exr` crate writes them in the order of a hash map, another
/// one in every run, and a file would not repeat byte for byte.
fn sort_attributes(file: &mut File) -> std::io::Result<()> {
    const START: usize = 8;
    let mut bytes = Vec::new();
    file.rewind()?;
    Read::take(&mut *file, 1 << 20).read_to_end(&mut bytes)?;
    let mut attributes = Vec::new();
    let mut rest = bytes.get(START..).unwrap_or_default();
    // Each is a name and a type, both ended by a zero, a length and as many bytes; an empty name ends the header.
    while rest.first().is_some_and(|&byte| byte != 0) {
        let end =
            |from: usize| Some(from + rest.get(from..)?.iter().position(|&byte| byte == 0)? + 1);
        let Some((attribute, after)) = end(0).and_then(end).and_then(|at| {
            let length = u32::from_le_bytes(rest.get(at..at + 4)?.try_into().ok()?);
            rest.split_at_checked(at + 4 + length as usize)
        }) else {
            return Ok(());
        };
        attributes.push(attribute);
        rest = after;
    }
    attributes.sort_unstable();
    file.seek(SeekFrom::Start(START as u64))?;
    file.write_all(&attributes.concat())
}

pub(super) fn load(path: &Path) -> Result<Image> {
    let file = File::open(path).map_err(|error| Error::io(path, error))?;
    let mut reader = BufReader::new(file);
    check_header(path, &mut reader)?;
    reader.rewind().map_err(|error| Error::io(path, error))?;
    let file: FlatImage = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(reader)
        .map_err(|error| failure(path, error))?;
    let Some(first) = file.layer_data.first() else {
        return Err(Error::malformed(path, "holds no image"));
    };
    let size = first.size;
    let mut image = Image::new(size.width() as u32, size.height() as u32);
    for (name, value) in &file.attributes.other {
        keep(&mut image, name, value);
    }
    for layer in file.layer_data {
        for (name, value) in &layer.attributes.other {
            keep(&mut image, name, value);
        }
        if layer.size != size {
            return Err(Error::malformed(path, "its parts differ in size"));
        }
        let prefix = layer.attributes.layer_name.as_ref().map(readable);
        for channel in layer.channel_data.list {
            let name = readable(&channel.name);
            let name = match &prefix {
                // A single part's name says nothing; of several parts each is a layer.
                Some(prefix) if image.channel(&name).is_some() => format!("{prefix}.{name}"),
                _ => name,
            };
            image.channels.push(Channel {
                name,
                samples: floats(channel.sample_data),
            });
        }
    }
    Ok(image)
}

/// Refuses what cannot be read before anything is allocated for it.
fn check_header(path: &Path, reader: &mut BufReader<File>) -> Result<()> {
    let file_bytes = reader
        .get_ref()
        .metadata()
        .map_err(|error| Error::io(path, error))?
        .len();
    if file_bytes == 0 {
        return Err(Error::malformed(path, "is empty"));
    }
    let meta = MetaData::read_from_buffered(reader, false).map_err(|error| failure(path, error))?;
    let mut bytes = 0_u64;
    for header in &meta.headers {
        if header.deep {
            return Err(Error::Unsupported {
                path: path.to_owned(),
                feature: "deep data".into(),
                remedy: "flatten the image first".into(),
            });
        }
        let IntegerBounds { size, .. } = header.data_window();
        check_size(path, size.width() as u64, size.height() as u64)?;
        if let Some(channel) = header
            .channels
            .list
            .iter()
            .find(|channel| channel.sampling != Vec2(1, 1))
        {
            return Err(Error::Unsupported {
                path: path.to_owned(),
                feature: format!("subsampling (of channel {})", channel.name),
                remedy: "save the image with all its channels at full size".into(),
            });
        }
        let samples = size.area() as u64 * header.channels.list.len() as u64;
        bytes = bytes.saturating_add(samples.saturating_mul(4));
    }
    if bytes > MAX_BYTES {
        return Err(Error::TooLarge {
            path: path.to_owned(),
            what: "its pixels".into(),
            bytes,
            limit: MAX_BYTES,
        });
    }
    if bytes > file_bytes.saturating_mul(MAX_RATIO) {
        let reason = format!("a file of {file_bytes} bytes cannot hold {bytes} bytes of pixels");
        return Err(Error::malformed(path, reason));
    }
    Ok(())
}

fn floats(samples: FlatSamples) -> Vec<f32> {
    match samples {
        FlatSamples::F32(samples) => samples,
        FlatSamples::F16(samples) => samples.into_iter().map(f32::from).collect(),
        FlatSamples::U32(samples) => samples.into_iter().map(|value| value as f32).collect(),
    }
}

fn keep(image: &mut Image, name: &Text, value: &AttributeValue) {
    let value = match value {
        AttributeValue::Text(text) => readable(text),
        AttributeValue::F32(value) => value.to_string(),
        AttributeValue::F64(value) => value.to_string(),
        AttributeValue::I32(value) => value.to_string(),
        _ => return,
    };
    image.attributes.insert(readable(name), value);
}

/// The format does not say how texts are encoded; they are UTF-8 here.
fn text(text: &str) -> Text {
    Text::from_slice_unchecked(text.as_bytes())
}

fn readable(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

fn failure(path: &Path, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            Error::io(path, error)
        }
        exr::error::Error::Io(_) => Error::malformed(path, "the file ends too early"),
        error => Error::malformed(path, format!("not a readable OpenEXR file: {error}")),
    }
}
