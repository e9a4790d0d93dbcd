//! Reads the statements of an OBJ file.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::text::{lines, number, statement, words};
use crate::{
    Result,
    load::{context::Context, pool::Pool},
    srgb_to_linear,
};

/// Stands for an index that is missing or refers to nothing.
pub(super) const NONE: u32 = u32::MAX;

/// Everything in a file, faces still polygons.
pub(super) struct Geometry<'a> {
    pub(super) positions: Pool<'a, Vec3>,
    /// Linear RGB; empty, or one per position.
    pub(super) colors: Pool<'a, Vec3>,
    /// With v upwards, as in the file.
    pub(super) uvs: Pool<'a, Vec2>,
    pub(super) normals: Pool<'a, Vec3>,
    pub(super) corners: Pool<'a, Corner>,
    pub(super) faces: Pool<'a, Face>,
    /// What faces are named after, by objects and groups.
    pub(super) groups: Names,
    /// The materials that faces ask for.
    pub(super) materials: Names,
    /// The rest of each `mtllib` line.
    pub(super) libraries: Vec<String>,
}

/// A corner of a face: indices from 0, possibly out of range, or [`NONE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Corner {
    pub(super) position: u32,
    pub(super) uv: u32,
    pub(super) normal: u32,
}

/// A polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    /// Where its corners begin.
    pub(super) first: u32,
    /// How many it has; at least 3.
    pub(super) corners: u32,
    /// Index in [`Geometry::groups`].
    pub(super) group: u32,
    /// Index in [`Geometry::materials`].
    pub(super) material: u32,
}

/// Different names, numbered in the order they came up. Name 0 is empty: for faces before any name.
pub(super) struct Names {
    pub(super) list: Vec<String>,
    index_of: HashMap<String, u32>,
    current: u32,
}

impl Names {
    fn new() -> Self {
        Self {
            list: vec![String::new()],
            index_of: HashMap::from([(String::new(), 0)]),
            current: 0,
        }
    }

    fn set(&mut self, context: &Context<'_>, name: &str) -> Result<()> {
        if let Some(&index) = self.index_of.get(name) {
            self.current = index;
            return Ok(());
        }
        // Twice the text and the rest of the two entries, doubled because lists grow by doubling.
        context
            .budget
            .claim("the names", 4 * name.len() as u64 + 250)?;
        self.current = self.list.len() as u32;
        self.list.push(name.to_owned());
        self.index_of.insert(name.to_owned(), self.current);
        Ok(())
    }
}

impl<'a> Geometry<'a> {
    /// Reads a whole file.
    pub(super) fn parse(context: &Context<'a>, text: &str) -> Result<Self> {
        let budget = context.budget;
        let mut geometry = Self {
            positions: Pool::new(budget, "the positions"),
            colors: Pool::new(budget, "the colours"),
            uvs: Pool::new(budget, "the texture coordinates"),
            normals: Pool::new(budget, "the normals"),
            corners: Pool::new(budget, "the corners of faces"),
            faces: Pool::new(budget, "the faces"),
            groups: Names::new(),
            materials: Names::new(),
            libraries: Vec::new(),
        };
        for line in lines(text) {
            if let Some((keyword, rest)) = statement(&line) {
                geometry.statement(context, keyword, rest)?;
            }
        }
        Ok(geometry)
    }

    fn statement(&mut self, context: &Context<'_>, keyword: &str, rest: &str) -> Result<()> {
        match keyword {
            "v" => self.vertex(rest)?,
            "vt" => {
                let mut numbers = words(rest).map(number);
                let u = numbers.next().unwrap_or(f32::NAN);
                self.uvs.push(Vec2::new(u, numbers.next().unwrap_or(0.0)))?;
            }
            "vn" => {
                let mut numbers = words(rest).map(number);
                let normal = [(); 3].map(|()| numbers.next().unwrap_or(f32::NAN));
                self.normals.push(normal.into())?;
            }
            "f" | "fo" => self.face(context, rest)?,
            "o" | "g" => self.groups.set(context, rest.trim_end())?,
            "usemtl" => self.materials.set(context, rest.trim_end())?,
            "mtllib" => {
                context.budget.claim("the names", rest.len() as u64 + 100)?;
                self.libraries.push(rest.trim_end().to_owned());
            }
            "l" | "p" => context.warn("points and lines are ignored"),
            "curv" | "curv2" | "surf" => {
                context.warn("free-form curves and surfaces are ignored; convert them to polygons");
            }
            _ => {}
        }
        Ok(())
    }

    /// `v x y z`, `v x y z w` (the weight is for curves only) or `v x y z r g b`.
    fn vertex(&mut self, rest: &str) -> Result<()> {
        let mut numbers = words(rest).map(number);
        let position = [(); 3].map(|()| numbers.next().unwrap_or(f32::NAN));
        let color = [(); 3].map(|()| numbers.next());
        if let [Some(r), Some(g), Some(b)] = color {
            while self.colors.len() < self.positions.len() {
                self.colors.push(Vec3::ONE)?;
            }
            let linear = [r, g, b].map(|value| srgb_to_linear(value.clamp(0.0, 1.0)));
            self.colors.push(linear.into())?;
        } else if !self.colors.is_empty() {
            self.colors.push(Vec3::ONE)?;
        }
        self.positions.push(position.into())
    }

    fn face(&mut self, context: &Context<'_>, rest: &str) -> Result<()> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let first = self.corners.len();
        for word in words(rest) {
            let mut references = word.split('/');
            let [position, uv, normal] =
                counts.map(|count| references.next().map_or(NONE, |word| index(word, count)));
            self.corners.push(Corner {
                position,
                uv,
                normal,
            })?;
        }
        let corners = self.corners.len() - first;
        if u32::try_from(self.corners.len()).is_err() {
            return Err(context.malformed("has more than 2³² corners of faces; split it"));
        }
        if corners < 3 {
            context.warn("faces with fewer than three corners are ignored");
            return Ok(());
        }
        self.faces.push(Face {
            first: first as u32,
            corners: corners as u32,
            group: self.groups.current,
            material: self.materials.current,
        })
    }
}

/// The index from 0 of a reference that counts from 1, or backwards from the last element so far.
fn index(reference: &str, count: usize) -> u32 {
    let index = match reference.parse::<i64>() {
        Ok(forward @ 1..) => forward - 1,
        Ok(backward @ ..0) => (count as i64).saturating_add(backward),
        Ok(0) | Err(_) => -1,
    };
    u32::try_from(index).unwrap_or(NONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references() {
        assert_eq!(index("1", 5), 0);
        assert_eq!(index("9", 5), 8);
        assert_eq!(index("-1", 5), 4);
        for wrong in ["0", "-6", "", "x", "-9223372036854775808", "4294967297"] {
            assert_eq!(index(wrong, 5), NONE, "{wrong}");
        }
    }
}
