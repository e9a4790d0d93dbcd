//! The environment through the maps: the first and the last layer of each pixel say whether anything is in its way.

use glam::{Vec3, Vec4};
use isophote_scene::{
    Scene, Selection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, Timer, UniformArray},
};
use wgpu::{BindGroup, Buffer, BufferUsages};

use super::super::{
    Filler, Points, fit, grid, linker,
    maps::{Asked, Batch, Builder, Kept, Series},
    triangles::Triangles,
};
use crate::{
    PhotonParams, Result,
    cpu::{
        environment::of_frames,
        view::{View, longest_axis},
    },
};

/// What shines from beyond the scene, and what is in its way.
#[derive(Debug)]
pub(super) struct Sky {
    params: PhotonParams,
    directions: Vec<Vec3>,
    /// Along each direction and along its opposite, W/(sr·m²).
    radiances: Vec<[Vec3; 2]>,
    triangles: Triangles,
    filler: Filler,
    builder: Builder,
    look_up: ComputePass,
}

/// The maps of a part, around points, and what comes along them.
pub(super) struct Ways {
    views: Vec<View>,
    radiances: Vec<[Vec4; 2]>,
}

/// Points that look along the maps of a part, batch by batch.
pub(super) struct Looks<'a> {
    sky: &'a Sky,
    series: Series<'a>,
    group: BindGroup,
    points: u32,
}

impl Ways {
    /// The sum of the mean cosines over a hemisphere, which are a half.
    pub(super) fn weight(&self) -> f32 {
        0.5 * self.views.len() as f32
    }
}

impl Sky {
    /// None where nothing shines.
    pub(super) fn new(
        context: &Context,
        (scene, gpu_scene): (&Scene, &GpuScene),
        selection: &Selection,
        params: &PhotonParams,
    ) -> Result<Option<Self>> {
        if !params.environment || scene.environment.is_black() {
            return Ok(None);
        }
        let (maps, environment) = (params.maps, &scene.environment);
        let filler = Filler::new(context)?;
        let look_up = linker()
            .feature("extents", true)
            .link("ldm_ambient::direct::sky")?;
        Ok(Some(Self {
            params: *params,
            directions: params.directions(),
            radiances: of_frames(environment, maps.maps, params.seed, params.frames),
            triangles: Triangles::new(context, scene, gpu_scene, selection, &filler)?,
            filler,
            builder: Builder::new(context, gpu_scene, Kept::Extents, maps.resolution)?,
            look_up: look_up.compute_pass(context, "sky", &[], &[0])?,
        }))
    }

    /// What positions of points are relative to, metres.
    pub(super) fn origin(&self) -> Vec3 {
        self.triangles.origin
    }

    /// Records where the triangles are.
    pub(super) fn begin(&self, encoder: &mut wgpu::CommandEncoder, gpu_scene: &GpuScene) {
        self.triangles.record(encoder, gpu_scene, &self.filler);
    }

    pub(super) fn ways(&self, context: &Context, points: &Points, [part, parts]: [u32; 2]) -> Ways {
        let part = || (part as usize..self.directions.len()).step_by(parts.max(1) as usize);
        let directions: Vec<Vec3> = part().map(|index| self.directions[index]).collect();
        let radiances = part().map(|index| self.radiances[index].map(|light| light.extend(0.0)));
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
            radiances: radiances.collect(),
        }
    }

    /// Ready to add to sums of pixels, by the albedos of their points.
    pub(super) fn looks<'a>(
        &'a self,
        context: &Context,
        ways: &'a Ways,
        points: &Points,
        [skies, albedos]: [&Buffer; 2],
    ) -> Result<Looks<'a>> {
        let [width, height] = points.size();
        let asked = Asked {
            points: width * height,
            tolerance: self.params.maps.tolerance,
            d_max: f32::INFINITY,
        };
        let (builder, triangles) = (&self.builder, &self.triangles);
        let series = builder.series(context, triangles, &ways.views, asked)?;
        let radiances = context.buffer("sky", &ways.radiances, BufferUsages::STORAGE)?;
        let [pixels, layers] = builder.tables();
        let resources = [
            (0, series.batches.binding()),
            pixels,
            layers,
            (3, points.buffer.as_entire_binding()),
            (4, skies.as_entire_binding()),
            (5, albedos.as_entire_binding()),
            (6, radiances.as_entire_binding()),
        ];
        Ok(Looks {
            sky: self,
            group: self.look_up.bind(context, &resources)?,
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
        let triangles = &self.sky.triangles;
        let timer_of_maps = timer.as_deref_mut();
        self.series
            .record(encoder, batch, triangles, gpu_scene, timer_of_maps);
        let dispatch = Dispatch {
            offset: Some(UniformArray::<Batch>::offset(batch as u32)),
            workgroups: grid(u64::from(self.points).div_ceil(64)),
        };
        let look_up = &self.sky.look_up;
        look_up.record(encoder, "sky", timer, &[&self.group], &[dispatch]);
    }
}
