//! A ray's way through a map: where it enters and which pixels it crosses, as a two-dimensional DDA.
//!
//! τ counts the depth steps that the ray has passed since it entered the map. Its depth changes by 1 per τ, up or
//! down; x and y change by `slope`. A map's axis is the ray's longest, so τ is never badly scaled.

use glam::{BVec2, DVec2, Vec2};
use isophote_scene::Ray;

use crate::cpu::maps::{Frame, pixel_index};

/// A slope that stands for 0, so that its inverse is a number.
pub(super) const LEAST_SLOPE: f64 = 1e-18;

/// A map as rays enter it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entrance<'a> {
    pub(crate) frame: &'a Frame,
    /// That of its depth.
    pub(crate) axis: usize,
    /// Pixels on a side, and steps of the depth.
    pub(crate) sides: [u32; 2],
}

/// The ray in the map's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Path {
    /// Pixels at τ = 0, inside the map.
    pub(super) start: Vec2,
    /// 1 / pixels per τ.
    pub(super) inverse: Vec2,
    /// Depth at τ = 0, in steps.
    pub(super) depth: f32,
    /// 1 or −1: whether the depth grows with τ.
    pub(crate) sign: f32,
    /// τ at the end of the ray or of the map.
    pub(crate) end: f32,
    /// τ of a point at t is `t · speed − offset`.
    pub(super) speed: f64,
    pub(super) offset: f64,
    /// The last pixel of a row.
    pub(super) last: i32,
    /// The last depth step.
    pub(super) last_depth: f32,
}

/// The minimum as one instruction has it: `b` where one is no number.
#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greatest(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// A pixel on the way, and the τ of its two ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Crossing {
    pub(crate) pixel: usize,
    pub(crate) enter: f32,
    pub(crate) exit: f32,
}

impl Path {
    /// None where the ray does not touch the map, or is none.
    #[inline(always)]
    pub(crate) fn new(map: &Entrance<'_>, ray: &Ray) -> Option<Self> {
        if !ray.is_valid() {
            return None;
        }
        let &Entrance {
            frame,
            axis,
            sides: [resolution, depth_steps],
        } = map;
        let place = frame.place(axis, ray.origin);
        let turn = frame.turn(axis, ray.direction);
        let speed = turn.z.abs();
        let sign = 1_f64.copysign(turn.z);
        let slope = turn.truncate() / speed;
        let tiny = BVec2::new(slope.x.abs() < LEAST_SLOPE, slope.y.abs() < LEAST_SLOPE);
        let slope = DVec2::select(tiny, DVec2::splat(LEAST_SLOPE), slope);
        let inverse = slope.recip();
        let side = f64::from(resolution);
        let positive = slope.cmpgt(DVec2::ZERO);
        let side = DVec2::splat(side);
        let near = (DVec2::select(positive, DVec2::ZERO, side) - place.truncate()) * inverse;
        let far = (DVec2::select(positive, side, DVec2::ZERO) - place.truncate()) * inverse;
        let depth_steps = f64::from(depth_steps);
        let [near_z, far_z] = if sign > 0.0 {
            [-place.z, depth_steps - place.z]
        } else {
            [place.z - depth_steps, place.z]
        };
        let offset = (f64::from(ray.t_min) * speed)
            .max(near.max_element())
            .max(near_z);
        let end = (f64::from(ray.t_max) * speed)
            .min(far.min_element())
            .min(far_z);
        // Also false for NaN.
        let touches = offset <= end;
        if !touches {
            return None;
        }
        Some(Self {
            start: (place.truncate() + slope * offset).as_vec2(),
            inverse: inverse.as_vec2(),
            depth: (place.z + sign * offset) as f32,
            sign: sign as f32,
            end: (end - offset) as f32,
            speed,
            offset,
            last: resolution as i32 - 1,
            last_depth: (depth_steps - 1.0) as f32,
        })
    }

    /// τ of a distance along the ray.
    #[inline(always)]
    pub(crate) fn tau(&self, t: f32) -> f32 {
        (f64::from(t) * self.speed - self.offset) as f32
    }

    /// The depth at τ, in whole steps.
    #[inline(always)]
    pub(crate) fn depth(&self, tau: f32) -> u32 {
        let depth = least(greatest(self.depth + self.sign * tau, 0.0), self.last_depth);
        #[expect(unsafe_code, reason = "a conversion without checks is one instruction")]
        // SAFETY: it lies between 0 and the last depth; `least` and `greatest` give their second argument for NaN.
        unsafe {
            depth.to_int_unchecked::<i32>() as u32
        }
    }

    /// The pixels in the order in which the ray crosses them.
    #[inline(always)]
    pub(crate) fn crossings(&self) -> Crossings<'_> {
        let clamp = |p: f32| (p as i32).clamp(0, self.last);
        let (x, y) = (clamp(self.start.x), clamp(self.start.y));
        let step = |inverse: f32| if inverse > 0.0 { 1 } else { -1 };
        let (step_x, step_y) = (step(self.inverse.x), step(self.inverse.y));
        let border_x = (x + (step_x + 1) / 2) as f32;
        let border_y = (y + (step_y + 1) / 2) as f32;
        Crossings {
            path: self,
            x,
            y,
            step_x,
            step_y,
            border_x,
            border_y,
            next_x: (border_x - self.start.x) * self.inverse.x,
            next_y: (border_y - self.start.y) * self.inverse.y,
            tau: 0.0,
        }
    }
}

/// A walk over the pixels of a path.
pub(crate) struct Crossings<'a> {
    path: &'a Path,
    x: i32,
    y: i32,
    step_x: i32,
    step_y: i32,
    /// The columns' and rows' next border.
    border_x: f32,
    border_y: f32,
    /// τ there; calculated anew for each border, so that no error adds up.
    next_x: f32,
    next_y: f32,
    /// τ at the end of the current pixel.
    tau: f32,
}

impl Crossings<'_> {
    /// The current pixel.
    #[inline(always)]
    pub(crate) fn current(&mut self) -> Crossing {
        let enter = self.tau;
        self.tau = least(least(self.next_x, self.next_y), self.path.end);
        let resolution = self.path.last as u32 + 1;
        Crossing {
            pixel: pixel_index(resolution, self.x as u32, self.y as u32),
            enter,
            exit: self.tau,
        }
    }

    /// Goes on to the next pixel; false where the ray ends, or is of no interest from `limit` on.
    #[inline(always)]
    pub(crate) fn step(&mut self, limit: f32) -> bool {
        if self.tau >= least(limit, self.path.end) {
            return false;
        }
        // Which way it goes cannot be foretold, so both are calculated.
        let (across, up) = if self.next_x < self.next_y {
            (self.step_x, 0)
        } else {
            (0, self.step_y)
        };
        self.x += across;
        self.y += up;
        self.border_x += across as f32;
        self.border_y += up as f32;
        self.next_x = (self.border_x - self.path.start.x) * self.path.inverse.x;
        self.next_y = (self.border_y - self.path.start.y) * self.path.inverse.y;
        let last = self.path.last as u32;
        (self.x as u32 <= last) & (self.y as u32 <= last)
    }
}
