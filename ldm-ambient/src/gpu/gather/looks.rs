//! Points that look along the maps for what lights them: surfaces where photons landed, and the environment where there are none.

use glam::{Vec3, Vec4};
use isophote_scene::{
    Aabb, Scene, Selection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer, Timer, UniformArray},
};
use wgpu::{BindGroup, Buffer, BufferUsages};

use super::{
    super::{
        BuildMethod, Filler, Points, broken, fit, grid, linker,
        maps::{Asked, Batch, Builder, Kept, Series},
        triangles::Triangles,
    },
    field::Field,
    rooms::Rooms,
};
use crate::{
    PhotonParams, Result,
    cpu::{
        environment::of_frames,
        photons,
        view::{View, longest_axis},
    },
};

/// What shines, and the maps through which it is seen.
#[derive(Debug)]
pub(super) struct Shining {
    params: PhotonParams,
    directions: Vec<Vec3>,
    /// From beyond the scene along each direction and along its opposite, W/(sr·m²).
    radiances: Vec<[Vec3; 2]>,
    triangles: Triangles,
    filler: Filler,
    builder: Builder,
    look: ComputePass,
    /// What surfaces send on, and how much room points have to look for it.
    field: Option<(Field, Rooms)>,
    /// What arrives at them straight from the lights.
    pub(super) landed: Option<Field>,
    /// Most layers that were needed, and whether any was lost.
    status: Buffer,
}

/// The maps of a part, around points, and what comes from beyond along them.
pub(super) struct Ways {
    views: Vec<View>,
    radiances: Vec<[Vec4; 2]>,
}

/// Points that look along the maps of a part, batch by batch.
pub(super) struct Looks<'a> {
    shining: &'a Shining,
    pass: (&'a str, &'a ComputePass),
    series: Series<'a>,
    group: BindGroup,
    points: u32,
}

impl Ways {
    /// The sum of the mean cosines over a hemisphere, which are a half.
    pub(super) fn weight(&self) -> f32 {
        0.5 * self.views.len() as f32
    }

    /// The largest pixel of the maps, metres.
    fn pixel(&self) -> f32 {
        let pixels = self.views.iter().map(|view| view.pixel);
        pixels.fold(0.0, f32::max)
    }
}

impl Shining {
    pub(super) fn new(
        context: &Context,
        (scene, gpu_scene): (&Scene, &GpuScene),
        selection: &Selection,
        params: &PhotonParams,
        photons: Option<&photons::Photons<'_>>,
        exact: &dyn GpuTracer,
    ) -> Result<Self> {
        let (maps, environment) = (params.maps, &scene.environment);
        let filler = Filler::new(context)?;
        let triangles = Triangles::new(context, scene, gpu_scene, selection, &filler)?;
        let packed = photons.map(|photons| photons.packed(triangles.origin));
        let upload = |packed: &_| Field::upload(context, packed);
        let [field, landed] = packed.unwrap_or_default();
        let field = match &field {
            Some(field) => Some((upload(field)?, Rooms::new(context, gpu_scene, exact)?)),
            None => None,
        };
        let landed = landed.as_ref().map(upload).transpose()?;
        // Whether there is anything is all that is asked of the maps where no surface shines.
        let kept = match field {
            // Summed up: there is no other way to fall back to, and looking takes longer than building here.
            Some(_) => Kept::Layers(BuildMethod::Linearised),
            None => Kept::Extents,
        };
        let look = "ldm_ambient::gather::look";
        Ok(Self {
            params: *params,
            directions: params.directions(),
            radiances: match params.environment {
                true => of_frames(environment, maps.maps, params.seed, params.frames),
                false => Vec::new(),
            },
            triangles,
            filler,
            builder: Builder::new(context, gpu_scene, kept, maps.resolution)?,
            look: pass(context, look, "look", (kept, field.is_some()))?,
            field,
            landed,
            status: context.storage("status", 8)?,
        })
    }

    /// Whether nothing is seen through the maps.
    pub(super) fn is_dark(&self) -> bool {
        self.field.is_none() && self.radiances.is_empty()
    }

    /// A pass that looks along the maps, by its module and entry point.
    pub(super) fn pass(
        &self,
        context: &Context,
        module: &str,
        entry_point: &'static str,
    ) -> Result<ComputePass> {
        let kinds = (self.builder.kept, self.field.is_some());
        pass(context, module, entry_point, kinds)
    }

    /// What positions of points are relative to, metres.
    pub(super) fn origin(&self) -> Vec3 {
        self.triangles.origin
    }

    /// Records where the triangles are.
    pub(super) fn begin(&self, encoder: &mut wgpu::CommandEncoder, gpu_scene: &GpuScene) {
        encoder.clear_buffer(&self.status, 0, None);
        self.triangles.record(encoder, gpu_scene, &self.filler);
    }

    pub(super) fn has_room(&mut self, context: &Context) -> Result<bool> {
        if self.field.is_none() {
            return Ok(true);
        }
        let status: Vec<u32> = context.read("status", &self.status, 2)?;
        if status[1] != 0 {
            return Err(broken("a pixel has more layers than there are"));
        }
        Ok(!self.builder.make_room(context, status[0])?)
    }

    pub(super) fn ways(&self, context: &Context, points: &Points, [part, parts]: [u32; 2]) -> Ways {
        let part = || (part as usize..self.directions.len()).step_by(parts.max(1) as usize);
        let directions: Vec<Vec3> = part().map(|index| self.directions[index]).collect();
        let beyond = |index: usize| {
            let light = self.radiances.get(index).copied().unwrap_or_default();
            light.map(|light| light.extend(0.0))
        };
        // A picture without a point is looked at as if it held everything.
        let all = [self.triangles.bounds];
        let boxes = match points.boxes.is_empty() {
            true => &all[..],
            false => &points.boxes[..],
        };
        let around = (self.triangles.origin, boxes);
        let longest = longest_axis(&self.triangles.bounds);
        let resolution = self.params.maps.resolution;
        Ways {
            views: fit(context, &directions, around, longest, resolution),
            radiances: part().map(beyond).collect(),
        }
    }

    /// The maps along some of the directions, each fitted around boxes of its own. What comes from beyond is not in them.
    pub(super) fn ways_around(&self, context: &Context, groups: &[(u32, Vec<Aabb>)]) -> Ways {
        let longest = longest_axis(&self.triangles.bounds);
        let view = |(number, boxes): &(u32, Vec<Aabb>)| {
            let direction = self.directions[*number as usize];
            let around = (self.triangles.origin, &boxes[..]);
            fit(
                context,
                &[direction],
                around,
                longest,
                self.params.maps.resolution,
            )
        };
        Ways {
            views: groups.iter().flat_map(view).collect(),
            radiances: vec![[Vec4::ZERO; 2]; groups.len()],
        }
    }

    /// Whether surfaces shine, for which points need room.
    pub(super) fn measures_room(&self) -> bool {
        self.field.is_some()
    }

    /// Records that the room of points is measured, where surfaces shine.
    pub(super) fn measure(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        on: (&GpuScene, &dyn GpuTracer),
        (ways, points): (&Ways, &Points),
        arriving: &Buffer,
    ) -> Result<()> {
        let Some((_, rooms)) = &self.field else {
            return Ok(());
        };
        let maps = (self.origin(), ways.pixel());
        rooms.record(context, encoder, on, maps, (points, arriving))
    }

    /// Points, ready to add to what arrives at them.
    pub(super) fn gather<'a>(
        &'a self,
        context: &Context,
        ways: &'a Ways,
        points: &Points,
        arriving: &Buffer,
    ) -> Result<Looks<'a>> {
        let [width, height] = points.size();
        let points = (&points.buffer, width * height);
        self.looks(context, ("gather", &self.look), ways, points, arriving)
    }

    /// So many points that look by a pass, and what they find.
    pub(super) fn looks<'a>(
        &'a self,
        context: &Context,
        pass: (&'a str, &'a ComputePass),
        ways: &'a Ways,
        (points, count): (&Buffer, u32),
        found: &Buffer,
    ) -> Result<Looks<'a>> {
        let asked = Asked {
            points: count,
            tolerance: self.params.maps.tolerance,
            d_max: f32::INFINITY,
        };
        let (builder, triangles) = (&self.builder, &self.triangles);
        let series = builder.series(context, triangles, &ways.views, asked)?;
        let radiances = context.buffer("beyond", &ways.radiances, BufferUsages::STORAGE)?;
        let [pixels, layers] = builder.tables();
        let mut resources = vec![
            (0, series.batches.binding()),
            pixels,
            layers,
            (3, points.as_entire_binding()),
            (4, found.as_entire_binding()),
            (5, self.status.as_entire_binding()),
            (6, radiances.as_entire_binding()),
        ];
        let field = self.field.iter();
        resources.extend(field.flat_map(|(field, _)| field.resources()));
        Ok(Looks {
            shining: self,
            group: pass.1.bind(context, &resources)?,
            pass,
            series,
            points: asked.points,
        })
    }
}

impl Looks<'_> {
    pub(super) fn len(&self) -> usize {
        self.series.len()
    }

    /// How many maps a batch has.
    pub(super) fn maps(&self, batch: usize) -> usize {
        self.series.maps(batch)
    }

    /// Records that a batch's maps are built and asked.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: usize,
        gpu_scene: &GpuScene,
        mut timer: Option<&mut Timer>,
    ) {
        let triangles = &self.shining.triangles;
        let timer_of_maps = timer.as_deref_mut();
        self.series
            .record(encoder, batch, triangles, gpu_scene, timer_of_maps);
        let dispatch = Dispatch {
            offset: Some(UniformArray::<Batch>::offset(batch as u32)),
            workgroups: grid(u64::from(self.points).div_ceil(64)),
        };
        let (name, pass) = self.pass;
        pass.record(encoder, name, timer, &[&self.group], &[dispatch]);
    }
}

/// A pass over maps of a kind, of surfaces with light or without.
fn pass(
    context: &Context,
    module: &str,
    entry_point: &'static str,
    (kept, has_field): (Kept, bool),
) -> Result<ComputePass> {
    let shader = linker()
        .feature("extents", kept == Kept::Extents)
        .feature("field", has_field)
        .link(module)?;
    Ok(shader.compute_pass(context, entry_point, &[], &[0])?)
}
