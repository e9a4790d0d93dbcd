//! The stages brought back.

use glam::{Vec3, Vec4};
use isophote_scene::{Error, Pass, SurfaceId, SurfacePoint, gpu::Context};

use super::InstantGi;
use crate::{
    Result, ShadowMaps, Stages,
    cpu::{emission::Vpl, maps::rays_of_map},
};

/// Words of a virtual point light.
const WORDS: usize = 3;

impl InstantGi {
    /// The stages' results, once what [`record`](Self::record) has recorded was submitted. Of what they took only rays are
    /// known. Of the virtual point lights' surfaces only place and normal are
    /// known.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails, leaves pixels unwritten or calculates what is no number.
    pub fn read(&self, context: &Context) -> Result<Stages> {
        let stages = &self.stages;
        let (direct, direct_rays) = colors(context, &stages.direct)?;
        let (specular, tree_rays, hidden_rays) = match self.passes.specular {
            Some(_) => {
                let (_, tree_rays) = colors(context, &self.targets.tree)?;
                let (specular, hidden_rays) = colors(context, &stages.specular)?;
                (specular, tree_rays, hidden_rays)
            }
            None => (vec![Vec3::ZERO; direct.len()], 0, 0),
        };
        let (_, sample_rays) = colors(context, self.targets.samples(stages))?;
        let (irradiance, refining_rays) = colors(context, &stages.irradiance)?;
        let (vpls, path_rays) = self.vpls(context)?;
        let camera_rays = match self.rasters {
            Some(_) => 0,
            None => direct.len() as u64,
        };
        let of_map = |maps: &ShadowMaps| rays_of_map(maps.resolution);
        let map_rays = vpls.len() as u64 * self.params.shadow_maps().map_or(0, of_map);
        let passes = [
            ("vpls", path_rays),
            ("camera", camera_rays),
            ("keep", 0),
            ("maps", map_rays),
            ("direct", direct_rays + tree_rays),
            ("mirrored", hidden_rays),
            ("indirect", sample_rays),
            ("filter", 0),
            (
                "refine",
                self.passes.refine.as_ref().map_or(0, |_| refining_rays),
            ),
            ("compose", 0),
        ];
        Ok(Stages {
            direct,
            specular,
            irradiance,
            indirect: colors(context, &stages.indirect)?.0,
            picture: colors(context, &stages.picture)?.0,
            vpls,
            passes: passes
                .map(|(name, rays)| Pass {
                    name,
                    rays,
                    ..Pass::default()
                })
                .into(),
        })
    }

    /// The virtual point lights, and the rays that light paths took.
    fn vpls(&self, context: &Context) -> Result<(Vec<Vpl>, u64)> {
        let buffer = &self.targets.vpls;
        let head: Vec<[u32; 4]> = context.read("virtual point lights", buffer, 1)?;
        let [count, rays, ..] = head[0];
        let room = self.params.most_lights();
        if count > room {
            return Err(broken(format!(
                "there are {count} virtual point lights of {room}"
            )));
        }
        let words = 1 + WORDS * count as usize;
        let words: Vec<[u32; 4]> = context.read("virtual point lights", buffer, words)?;
        let vector = |[x, y, z, _]: [u32; 4]| Vec3::from_array([x, y, z].map(f32::from_bits));
        let vpl = |words: &[[u32; 4]]| {
            let normal = vector(words[1]);
            Vpl {
                point: SurfacePoint {
                    surface: SurfaceId::UNKNOWN,
                    position: vector(words[0]),
                    error: f32::from_bits(words[0][3]),
                    geometric_normal: normal,
                    shading_normal: normal,
                    uvs: Default::default(),
                    color: Vec4::ONE,
                    material: 0,
                },
                normal,
                intensity: vector(words[2]),
                bounce: words[1][3],
            }
        };
        Ok((
            words[1..].chunks_exact(WORDS).map(vpl).collect(),
            rays.into(),
        ))
    }
}

/// The colours of a texture, and the rays they took: behind each colour stands 1 and its rays.
fn colors(context: &Context, texture: &wgpu::Texture) -> Result<(Vec<Vec3>, u64)> {
    let texels: Vec<Vec4> = context.read_texture("reading a stage", texture)?;
    let mut rays = 0;
    let colors = texels.into_iter().map(|texel| {
        let color = texel.truncate();
        // A little less than 1 may be left by a filter.
        if !color.is_finite() || texel.w.is_nan() || texel.w < 0.99 {
            return Err(broken(format!("a pixel is {texel}")));
        }
        rays += texel.w as u64 - u64::from(texel.w >= 1.0);
        Ok(color)
    });
    let colors = colors.collect::<Result<_>>()?;
    Ok((colors, rays))
}

fn broken(what: String) -> crate::Error {
    Error::Gpu {
        what: "instant global illumination".into(),
        reason: format!("{what}: the device did not finish, or its driver is broken"),
    }
    .into()
}
