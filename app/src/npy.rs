//! Rays and hits as NumPy files.

use std::{
    fs::File,
    io::{BufReader, Read, Seek},
    path::Path,
};

use anyhow::{Context, Result, ensure};
use glam::Vec3;
use isophote_scene::{Error, Ray, write_atomically};
use npyz::{DType, NpyFile, Order, TypeChar, WriterBuilder};

/// A header that describes an array of numbers is far shorter; NumPy itself pads it to multiples of 64.
const MAX_HEADER: u32 = 1024;

/// Reads rays: float32, shape (N, 8), origin, `t_min`, direction, `t_max`.
pub(crate) fn read_rays(path: &Path) -> Result<Vec<Ray>> {
    let at = || path.display();
    let file = File::open(path).map_err(|error| anyhow::anyhow!("{}: {error}", at()))?;
    let file_bytes = file.metadata()?.len();
    ensure!(file_bytes > 0, "{}: is empty", at());
    let mut reader = BufReader::with_capacity(1 << 20, file);
    check_header(&mut reader).with_context(|| format!("{}: not a readable .npy file", at()))?;
    reader.rewind()?;
    let array =
        NpyFile::new(&mut reader).with_context(|| format!("{}: not a readable .npy file", at()))?;
    let DType::Plain(kind) = array.dtype() else {
        anyhow::bail!("{}: holds records, but rays are plain float32", at());
    };
    ensure!(
        kind.type_char() == TypeChar::Float && kind.size_field() == 4,
        "{}: holds {kind}, but rays are float32",
        at()
    );
    let shape = array.shape().to_vec();
    ensure!(
        shape.len() == 2 && shape[1] == 8,
        "{}: has the shape {shape:?}, but rays have (N, 8): origin, t_min, direction, t_max",
        at()
    );
    let fortran = array.order() == Order::Fortran;
    let count = shape[0];
    let promised = u128::from(count) * 32;
    ensure!(
        promised <= u128::from(file_bytes),
        "{}: is cut: its header promises {count} rays, which is {promised} bytes, but the file has {file_bytes}",
        at()
    );
    let values: Vec<f32> = array
        .into_vec()
        .with_context(|| format!("{}: is cut", at()))?;
    let count = count as usize;
    let value = |ray: usize, column: usize| {
        if fortran {
            values[column * count + ray]
        } else {
            values[8 * ray + column]
        }
    };
    let vector = |ray: usize, column: usize| {
        Vec3::new(
            value(ray, column),
            value(ray, column + 1),
            value(ray, column + 2),
        )
    };
    Ok((0..count)
        .map(|ray| Ray {
            origin: vector(ray, 0),
            t_min: value(ray, 3),
            direction: vector(ray, 4),
            t_max: value(ray, 7),
        })
        .collect())
}

/// Refuses headers that the parser would take as orders: for memory, for depth, or for sizes whose product overflows.
fn check_header(reader: &mut impl Read) -> Result<()> {
    let mut start = [0; 8];
    reader.read_exact(&mut start)?;
    ensure!(&start[..6] == b"\x93NUMPY", "it does not start as one");
    let length = if start[6] == 1 {
        let mut bytes = [0; 2];
        reader.read_exact(&mut bytes)?;
        u32::from(u16::from_le_bytes(bytes))
    } else {
        let mut bytes = [0; 4];
        reader.read_exact(&mut bytes)?;
        u32::from_le_bytes(bytes)
    };
    ensure!(length <= MAX_HEADER, "its header has {length} bytes");
    let mut header = vec![0; length as usize];
    reader.read_exact(&mut header)?;
    let count = |wanted: &dyn Fn(&u8) -> bool| header.iter().filter(|byte| wanted(byte)).count();
    ensure!(
        count(&|byte| b"([{".contains(byte)) <= 8 && count(&u8::is_ascii_digit) <= 18,
        "its header describes no array of rays"
    );
    Ok(())
}

/// Writes an array of `columns` float32 per row.
pub(crate) fn write(path: &Path, columns: usize, values: &[f32]) -> Result<()> {
    let shape = [(values.len() / columns) as u64, columns as u64];
    let failed = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    write_atomically(path, |writer| {
        let mut array = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&shape)
            .writer(writer)
            .begin_nd()
            .map_err(failed)?;
        array.extend(values.iter().copied()).map_err(failed)?;
        array.finish().map_err(failed)
    })?;
    Ok(())
}

/// Writes rays as [`read_rays`] reads them.
pub(crate) fn write_rays(path: &Path, rays: &[Ray]) -> Result<()> {
    let values: Vec<f32> = rays
        .iter()
        .flat_map(|ray| {
            let (o, d) = (ray.origin, ray.direction);
            [o.x, o.y, o.z, ray.t_min, d.x, d.y, d.z, ray.t_max]
        })
        .collect();
    write(path, 8, &values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(header: &str, data: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rays.npy");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16 + 1).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.push(b'\n');
        bytes.extend(data);
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }

    fn header(dtype: &str, fortran: bool, shape: &str) -> String {
        let order = if fortran { "True" } else { "False" };
        format!("{{'descr': '{dtype}', 'fortran_order': {order}, 'shape': {shape}, }}")
    }

    fn error(header: &str, data: &[u8]) -> String {
        let (_folder, path) = written(header, data);
        format!("{:#}", read_rays(&path).unwrap_err())
    }

    #[test]
    fn rays_survive() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rays.npy");
        let rays = vec![
            Ray::new(Vec3::ONE, Vec3::NEG_Z),
            Ray::new(Vec3::NAN, Vec3::ZERO).until(2.0),
        ];
        write_rays(&path, &rays).unwrap();
        let read = read_rays(&path).unwrap();
        assert_eq!(read[0], rays[0]);
        assert!(read[1].origin.is_nan() && read[1].t_max == 2.0);
        write_rays(&path, &[]).unwrap();
        assert!(read_rays(&path).unwrap().is_empty());
    }

    #[test]
    fn both_orders_and_byte_orders_are_read() {
        let value = |ray: usize, column: usize| (10 * ray + column) as f32;
        let rows: Vec<u8> = (0..16)
            .flat_map(|i| value(i / 8, i % 8).to_le_bytes())
            .collect();
        let columns: Vec<u8> = (0..16)
            .flat_map(|i| value(i % 2, i / 2).to_be_bytes())
            .collect();
        let (_a, c_order) = written(&header("<f4", false, "(2, 8)"), &rows);
        let (_b, fortran) = written(&header(">f4", true, "(2, 8)"), &columns);
        let rays = read_rays(&c_order).unwrap();
        assert_eq!(rays[1].direction, Vec3::new(14.0, 15.0, 16.0));
        assert_eq!(rays, read_rays(&fortran).unwrap());
    }

    #[test]
    fn lies_are_found() {
        let data = [0; 64];
        assert!(error(&header("<f8", false, "(1, 8)"), &data).contains("float32"));
        assert!(error(&header("<i4", false, "(2, 8)"), &data).contains("float32"));
        assert!(error(&header("|O", false, "(2, 8)"), &data).contains("float32"));
        assert!(error(&header("<f4", false, "(4, 4)"), &data).contains("shape"));
        assert!(error(&header("<f4", false, "(16,)"), &data).contains("shape"));
        assert!(error(&header("<f4", false, "(-2, 8)"), &data).contains("readable"));
        let huge = header("<f4", false, "(99999999999999999, 8)");
        assert!(error(&huge, &data).contains("describes no"));
        let many = header("<f4", false, "(9999999999, 8)");
        assert!(error(&many, &data).contains("is cut"));
        assert!(error(&header("<f4", false, "(2, 8)"), &data[1..]).contains("is cut"));
        assert!(error(&"(".repeat(1000), &data).contains("describes no"));
        assert!(error(&"x".repeat(2000), &data).contains("2001 bytes"));
        assert!(error("{}", &data).contains("readable"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rays.npy");
        for bytes in [
            &b""[..],
            b"\x93NUM",
            b"\x93NUMPY\x01\x00",
            b"\x93NUMPY\x02\x00\xff\xff\xff\xff",
        ] {
            std::fs::write(&path, bytes).unwrap();
            assert!(read_rays(&path).is_err());
        }
    }
}
