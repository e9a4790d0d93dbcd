//! The stages' shaders, and what they leave to each other.

use isophote_filters::gpu::texture;
use isophote_scene::{
    Error,
    gpu::{ComputePass, Context, Dispatch, Linker, Rasters, UniformArray, reference::World},
};
use wgpu::{BindingResource, TextureFormat, TextureView};

use super::{Piece, SHADERS, StageTextures, WORKGROUP};
use crate::{GiParams, Result, cpu::filter::Upsample};

/// Bytes of a virtual point light: three words of four.
const VPL: u64 = 48;

/// Bytes of a point of the picture, and how many there are: as in keep.wesl.
const POINT: u64 = 48;
pub(super) const POINTS: u64 = 4096;

/// A pass, and what it binds.
#[derive(Debug)]
pub(super) struct Bound {
    pub(super) compute: ComputePass,
    pub(super) group: wgpu::BindGroup,
    /// How many of exact tracer, scene and secondary tracer.
    pub(super) others: usize,
    /// Another renderer's G-buffer, in the secondary tracer's place.
    pub(super) rasters: Option<wgpu::BindGroup>,
}

/// What the passes bind.
pub(super) struct Shared<'a> {
    pub(super) targets: &'a Targets,
    pub(super) stages: &'a StageTextures,
    pub(super) settings: &'a wgpu::Buffer,
    pub(super) pieces: &'a UniformArray<Piece>,
    pub(super) rasters: Option<&'a Rasters>,
}

impl<'a> Shared<'a> {
    /// Everything that any pass binds as group 0, by its binding.
    fn resources(&self, views: &'a [(u32, TextureView)]) -> Vec<(u32, BindingResource<'a>)> {
        let Targets { shot, vpls, .. } = self.targets;
        let unsorted = self.targets.unsorted.as_ref().unwrap_or(vpls);
        let points = self.targets.points.as_ref().unwrap_or(vpls);
        // Paths are done with once their lights are brought together.
        let sorted = match self.targets.points {
            Some(_) => shot,
            None => vpls,
        };
        let views = views.iter();
        [
            (0, self.settings.as_entire_binding()),
            (PIECE, self.pieces.binding()),
            (2, shot.as_entire_binding()),
            (3, unsorted.as_entire_binding()),
            (9, vpls.as_entire_binding()),
            (27, unsorted.as_entire_binding()),
            (28, sorted.as_entire_binding()),
            (34, points.as_entire_binding()),
            (35, points.as_entire_binding()),
            (36, shot.as_entire_binding()),
            (37, vpls.as_entire_binding()),
        ]
        .into_iter()
        .chain(views.map(|(binding, view)| (*binding, BindingResource::TextureView(view))))
        .collect()
    }
}

/// The passes, in the order of the stages.
#[derive(Debug)]
pub(super) struct Passes {
    pub(super) shoot: Bound,
    pub(super) compact: Bound,
    /// `None` where neither points nor the picture choose lights.
    pub(super) sort: Option<Bound>,
    pub(super) camera: Bound,
    /// Points of the picture, what lights bring them, and the choice; `None` where all lights are kept.
    pub(super) keep: Option<[Bound; 3]>,
    /// `None` where points see the lights by rays.
    pub(super) maps: Option<Bound>,
    pub(super) direct: Bound,
    /// The tree of rays, and the light of the virtual point lights on what it shows; `None` where nothing mirrors or refracts.
    pub(super) specular: Option<[Bound; 2]>,
    pub(super) indirect: Bound,
    /// `None` where samples compute their own part of the lights alone.
    pub(super) fill: Option<Bound>,
    /// `None` where filters have the last word.
    pub(super) refine: Option<Bound>,
    pub(super) compose: Bound,
}

/// The binding of `piece`.
const PIECE: u32 = 1;

impl Passes {
    /// Links and compiles everything for the tracers of `world`.
    pub(super) fn new(
        context: &Context,
        world: &World<'_>,
        params: &GiParams,
        reflects: bool,
        shared: &Shared<'_>,
    ) -> Result<Self> {
        let linker = Linker::default()
            .package(SHADERS)
            .scene(world.gpu_scene)
            .tracer(world.exact)
            .secondary(world.secondary)
            .feature("compensated", params.compensates())
            .feature("filled", params.fills())
            .feature("foreign", shared.rasters.is_some())
            .feature("maps", params.shadow_maps().is_some())
            .feature("mirrored", false)
            .feature("selected", params.selection > 0)
            .feature("sorted", params.sorts());
        let groups = [
            world.exact.bind_group_layout(),
            world.gpu_scene.bind_group_layout(),
            world.secondary.bind_group_layout(),
        ];
        let views = shared.targets.views(shared.stages);
        let resources = shared.resources(&views);
        let linked = |linker: &Linker, module: &str, entry_point, others: usize| -> Result<Bound> {
            let shader = linker.link(&format!("instant_gi::{module}"))?;
            let compute = shader.compute_pass(context, entry_point, &groups[..others], &[PIECE])?;
            Ok(Bound {
                group: compute.bind(context, &resources)?,
                compute,
                others,
                rasters: None,
            })
        };
        let adopt = |rasters: &Rasters| -> Result<Bound> {
            let groups = [groups[0], groups[1], rasters.bind_group_layout()];
            let shader = linker.link("instant_gi::foreign")?;
            let compute = shader.compute_pass(context, "adopt", &groups, &[PIECE])?;
            Ok(Bound {
                group: compute.bind(context, &resources)?,
                compute,
                others: 3,
                rasters: Some(rasters.bind_group().clone()),
            })
        };
        let bound = |module, entry_point, others| linked(&linker, module, entry_point, others);
        let lit = linker.clone().feature("mirrored", true);
        Ok(Self {
            shoot: bound("emission", "shoot", 2)?,
            compact: bound("emission", "compact", 0)?,
            sort: match params.sorts() {
                true => Some(bound("curve", "sort", 0)?),
                false => None,
            },
            keep: match params.kept {
                0 => None,
                _ => Some([
                    bound("keep", "look", 2)?,
                    bound("keep", "weigh", 0)?,
                    bound("keep", "keep", 0)?,
                ]),
            },
            camera: match shared.rasters {
                Some(rasters) => adopt(rasters)?,
                None => bound("gbuffer", "camera", 2)?,
            },
            maps: match params.shadow_maps() {
                Some(_) => Some(bound("maps", "maps", 3)?),
                None => None,
            },
            direct: bound("direct", "direct", 2)?,
            specular: match reflects {
                true => Some([
                    bound("specular", "specular", 2)?,
                    linked(&lit, "specular", "specular", 3)?,
                ]),
                false => None,
            },
            indirect: bound("indirect", "indirect", 3)?,
            fill: match params.fills() {
                true => Some(bound("fill", "fill", 3)?),
                false => None,
            },
            refine: match params.refines() {
                true => Some(bound("refine", "refine", 3)?),
                false => None,
            },
            compose: bound("compose", "compose", 2)?,
        })
    }
}

/// What the stages leave to each other.
#[derive(Debug)]
pub(super) struct Targets {
    /// Room for the lights of each path; then the lights along the curve, where some of them are kept.
    shot: wgpu::Buffer,
    /// The lights in the order of their paths, where they are sorted.
    unsorted: Option<wgpu::Buffer>,
    /// Points of the picture, where lights are kept by what they bring them.
    points: Option<wgpu::Buffer>,
    pub(super) vpls: wgpu::Buffer,
    hits: TextureView,
    pub(super) normals: TextureView,
    pub(super) depths: TextureView,
    /// Base colours, where another renderer tells them.
    colors: Option<TextureView>,
    /// What the tree of rays found without the virtual point lights.
    pub(super) tree: wgpu::Texture,
    /// `None` where the samples are the picture.
    samples: Option<wgpu::Texture>,
    /// Of each sample its part of the light, where the others are filled in.
    parts: Option<wgpu::Texture>,
    /// What the filters leave, where pixels are refined.
    filtered: Option<wgpu::Texture>,
    /// The shadow maps of the lights, where points see by them.
    pub(super) atlas: Option<Atlas>,
    maps: Option<wgpu::Texture>,
    pub(super) sample_normals: TextureView,
    pub(super) sample_depths: TextureView,
    /// The dispatches over all paths and all pixels.
    pub(super) paths: [Dispatch; 1],
    pub(super) pixels: [Dispatch; 1],
}

impl Targets {
    pub(super) fn new(
        context: &Context,
        params: &GiParams,
        upsample: &Upsample,
        size: [u32; 2],
        is_foreign: bool,
    ) -> Result<(Self, StageTextures)> {
        check_sides(context, size)?;
        let atlas = Atlas::new(context, params)?;
        let grid = upsample.grid.size().map(|side| side as u32);
        let room = VPL * u64::from(params.paths) * u64::from(params.bounces);
        let color = TextureFormat::Rgba32Float;
        let picture = |label| texture(context, label, size, color);
        let guide = |label, size| -> Result<TextureView> {
            Ok(whole(&texture(context, label, size, color)?))
        };
        let stages = StageTextures {
            direct: picture("direct")?,
            specular: picture("specular")?,
            irradiance: picture("irradiance")?,
            indirect: picture("indirect")?,
            picture: picture("picture")?,
        };
        let hits = texture(context, "hits", size, TextureFormat::Rgba32Uint)?;
        let targets = Self {
            shot: context.storage("light paths", 16 + room)?,
            unsorted: match params.sorts() {
                false => None,
                true => Some(context.storage("virtual point lights by their paths", 16 + room)?),
            },
            points: match params.kept {
                0 => None,
                _ => Some(context.storage("points of the picture", POINT * POINTS)?),
            },
            vpls: context.storage(
                "virtual point lights",
                16 + VPL * u64::from(params.most_lights()),
            )?,
            hits: whole(&hits),
            normals: guide("normals", size)?,
            depths: guide("depths", size)?,
            colors: match is_foreign {
                true => Some(guide("base colours", size)?),
                false => None,
            },
            tree: picture("specular but for virtual point lights")?,
            samples: match upsample.is_copy() {
                true => None,
                false => Some(texture(context, "samples", grid, color)?),
            },
            parts: match params.fills() {
                true => Some(texture(context, "parts", grid, color)?),
                false => None,
            },
            filtered: match params.refines() {
                true => Some(texture(context, "filtered", size, color)?),
                false => None,
            },
            atlas,
            maps: match &atlas {
                Some(atlas) => Some(texture(
                    context,
                    "shadow maps",
                    atlas.size(),
                    TextureFormat::R32Float,
                )?),
                None => None,
            },
            sample_normals: guide("normals of samples", grid)?,
            sample_depths: guide("depths of samples", grid)?,
            paths: [Dispatch {
                offset: None,
                workgroups: [params.paths.div_ceil(WORKGROUP), 1, 1],
            }],
            pixels: [Dispatch::over_pixels(size)],
        };
        Ok((targets, stages))
    }

    /// Where stage 5 leaves irradiance.
    pub(super) fn samples<'a>(&'a self, stages: &'a StageTextures) -> &'a wgpu::Texture {
        self.samples.as_ref().unwrap_or(&stages.irradiance)
    }

    /// Where the filters leave it.
    pub(super) fn filtered<'a>(&'a self, stages: &'a StageTextures) -> &'a wgpu::Texture {
        self.filtered.as_ref().unwrap_or(&stages.irradiance)
    }

    /// By their bindings in the shaders.
    fn views(&self, stages: &StageTextures) -> [(u32, TextureView); 27] {
        let samples = self.samples(stages);
        let own = whole(self.parts.as_ref().unwrap_or(samples));
        let maps = whole(self.maps.as_ref().unwrap_or(samples));
        let colors = self.colors.as_ref().unwrap_or(&self.normals);
        let [direct, specular, irradiance, indirect, picture] = [
            &stages.direct,
            &stages.specular,
            &stages.irradiance,
            &stages.indirect,
            &stages.picture,
        ]
        .map(whole);
        [
            (4, self.hits.clone()),
            (5, self.normals.clone()),
            (6, self.depths.clone()),
            (7, self.hits.clone()),
            (8, direct.clone()),
            (10, own.clone()),
            (11, self.sample_normals.clone()),
            (12, self.sample_depths.clone()),
            (13, whole(&self.tree)),
            (14, specular.clone()),
            (15, direct),
            (16, specular),
            (17, irradiance.clone()),
            (18, indirect),
            (19, picture),
            (20, own),
            (21, self.sample_normals.clone()),
            (22, self.sample_depths.clone()),
            (23, whole(samples)),
            (24, whole(&self.tree)),
            (25, maps.clone()),
            (26, maps),
            (29, whole(self.filtered(stages))),
            (30, irradiance),
            (31, colors.clone()),
            (32, self.normals.clone()),
            (33, colors.clone()),
        ]
    }
}

/// The shadow maps of all lights beside and below each other in one texture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Atlas {
    /// Texels of a map's side.
    side: u32,
    /// Maps beside each other, and how many there is room for.
    pub(super) columns: u32,
    maps: u32,
}

impl Atlas {
    /// Room for every light that there can be; `None` where points see them by rays.
    fn new(context: &Context, params: &GiParams) -> Result<Option<Self>> {
        let Some(maps) = params.shadow_maps() else {
            return Ok(None);
        };
        let most = context.device().limits().max_texture_dimension_2d;
        let (side, lights) = (maps.resolution, params.most_lights());
        let columns = lights.min(most / side);
        if columns == 0 || lights.div_ceil(columns) > most / side {
            let area = 4 * u64::from(side) * u64::from(side);
            return Err(Error::GpuLimit {
                what: format!("shadow maps of {side} × {side} texels for {lights} lights"),
                needs: area * u64::from(lights),
                limit: 4 * u64::from(most) * u64::from(most),
                adapter: context.device().adapter_info().name,
            }
            .into());
        }
        Ok(Some(Self {
            side,
            columns,
            maps: lights,
        }))
    }

    /// Of all texels that lights can have.
    pub(super) fn texels(&self) -> u32 {
        self.side * self.side * self.maps
    }

    fn size(&self) -> [u32; 2] {
        [self.columns, self.maps.div_ceil(self.columns)].map(|maps| maps * self.side)
    }
}

/// Refuses pictures that are wider or higher than textures can be, before any is made.
fn check_sides(context: &Context, [width, height]: [u32; 2]) -> Result<()> {
    let most = context.device().limits().max_texture_dimension_2d;
    if width.max(height) <= most {
        return Ok(());
    }
    let bytes = |width: u32, height: u32| 16 * u64::from(width) * u64::from(height);
    Err(Error::GpuLimit {
        what: format!("a picture of {width} × {height} pixels"),
        needs: bytes(width, height),
        limit: bytes(most, most),
        adapter: context.device().adapter_info().name,
    }
    .into())
}

/// A texture's only view.
pub(super) fn whole(texture: &wgpu::Texture) -> TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
