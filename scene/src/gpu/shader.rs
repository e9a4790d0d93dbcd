//! Shaders: WESL modules of several crates, linked into one WGSL text at run time.
//!
//! A crate lists its modules with [`shader_package!`](crate::shader_package). In WESL an import names the package
//! first: `import scene::ray::{Ray, Hit};` is the module `ray` of this crate, `import package::…` one of the own
//! crate. The package `tracer` is whichever [`GpuTracer`](super::GpuTracer) a pipeline is built with:
//! `import tracer::{closest_hit, any_hit};`. A shader that asks two tracers imports the other from `secondary`, and binds
//! it as group 3.
//!
//! Names are only found through `import` statements at the top of a module, before directives like `enable`.

mod locate;
mod replaced;

use std::{borrow::Cow, sync::Arc};

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use wesl::{
    CompileOptions, Diagnostic, EscapeMangler, ModulePath, ResolveError, Resolver,
    syntax::{PathOrigin, TranslationUnit},
};

pub use self::replaced::replace_modules;
use super::{Context, GpuScene, GpuTracer};
use crate::{Error, Result, shader_package};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage = shader_package!(
    "scene",
    [
        "boxes",
        "bsdf",
        "emission",
        "gbuffer/raster",
        "gbuffer/read",
        "lighting",
        "ray",
        "reference/camera",
        "reference/direct",
        "reference/light_sampling",
        "reference/lit",
        "reference/occlusion",
        "reference/path",
        "reference/work",
        "sample",
        "scene_data",
        "seen",
        "shadow/raster",
        "shadow/read",
        "surface",
        "texture",
        "trace_batch",
        "tracer/compute_bvh",
        "tracer/ray_query",
        "tracer/ray_query_boxes",
        "triangle",
        "view",
        "words"
    ]
);

/// The WESL modules of a crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShaderPackage {
    /// What `import` statements call it.
    pub name: &'static str,
    /// Name below `shaders/`, without suffix, and text of each module.
    pub modules: &'static [(&'static str, &'static str)],
}

/// Embeds WESL modules of the calling crate: the name of the package, then their names below `shaders/`, without suffix.
///
/// ```ignore
/// const SHADERS: ShaderPackage = shader_package!("ldi", ["peel", "trace"]);
/// ```
#[macro_export]
macro_rules! shader_package {
    ($name:literal, [$($module:literal),+ $(,)?]) => {
        $crate::gpu::ShaderPackage {
            name: $name,
            modules: &[$((
                $module,
                include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $module, ".wesl")),
            )),+],
        }
    };
}

/// Links modules; this crate's are always there.
#[derive(Clone, Debug)]
pub struct Linker {
    packages: Vec<ShaderPackage>,
    tracer: Option<&'static str>,
    secondary: Option<&'static str>,
    features: Vec<(String, bool)>,
}

impl Default for Linker {
    fn default() -> Self {
        Self {
            packages: vec![SHADERS],
            tracer: None,
            secondary: None,
            features: Vec::new(),
        }
    }
}

impl Linker {
    /// Adds a crate's modules.
    #[must_use]
    pub fn package(mut self, package: ShaderPackage) -> Self {
        if !self.packages.contains(&package) {
            self.packages.push(package);
        }
        self
    }

    /// Says whom `import tracer::…` stands for.
    #[must_use]
    pub fn tracer(mut self, tracer: &dyn GpuTracer) -> Self {
        self.tracer = Some(tracer.module());
        let packages = tracer.packages().iter();
        let linker = packages.fold(self, |linker, &package| linker.package(package));
        let flags = tracer.shader_flags().iter();
        flags.fold(linker, |linker, flag| linker.feature(flag, true))
    }

    /// Says whom `import secondary::…` stands for, in shaders that ask two tracers. It may be of the same kind as the other:
    /// its modules are linked once more, with group 3 in the place of group 1.
    #[must_use]
    pub fn secondary(mut self, tracer: &dyn GpuTracer) -> Self {
        self.secondary = Some(tracer.module());
        let packages = tracer.packages().iter();
        let linker = packages.fold(self, |linker, &package| linker.package(package));
        let flags = tracer.shader_flags().iter();
        flags.fold(linker, |linker, flag| {
            linker.feature(&format!("{SECONDARY}_{flag}"), true)
        })
    }

    /// Says how the data of the scene that will be bound are read. Those of most scenes are read as without this; a
    /// pipeline for one that is too large for buffers would not be valid.
    #[must_use]
    pub fn scene(self, scene: &GpuScene) -> Self {
        self.feature("scene_in_textures", scene.is_in_textures())
    }

    /// Sets a flag of conditional translation (`@if(name)`); those not set are off.
    #[must_use]
    pub fn feature(mut self, name: &str, on: bool) -> Self {
        self.features.push((name.into(), on));
        self
    }

    /// Links the entry points of a module, `package::module`, with everything they use, and validates the result.
    ///
    /// # Errors
    /// [`Error::Shader`] with file and line.
    pub fn link(&self, module: &str) -> Result<Shader> {
        let path = self.path(module)?;
        let mut options = CompileOptions::default();
        for (name, on) in &self.features {
            options.features.flags.insert(name.clone(), (*on).into());
        }
        let linked = wesl::compile(&path, self, &EscapeMangler, &options)
            .map_err(|error| self.shader_error(&path, error.into()))?;
        let wgsl = linked.to_string();
        Ok(Shader {
            name: module.into(),
            checked: Arc::new(self.validate(&wgsl, &path)?),
            wgsl,
        })
    }

    /// `package::folder::module` as a path from the root.
    fn path(&self, module: &str) -> Result<ModulePath> {
        let path = ModulePath {
            origin: PathOrigin::Absolute,
            components: module.split("::").map(str::to_owned).collect(),
        };
        match self.find(&path) {
            Some(_) => Ok(path),
            None => Err(Error::Shader {
                file: module.into(),
                line: 0,
                message: "there is no such module; is its package given to the linker?".into(),
            }),
        }
    }

    /// The file's name and text. All packages lie below one root, so that a module is the same from wherever it is
    /// imported.
    fn find(&self, path: &ModulePath) -> Option<(String, &'static str)> {
        let path: Vec<&str> = path.components.iter().map(String::as_str).collect();
        let (package, module) = path.split_first()?;
        let name = module.join("/");
        let package = match *package {
            SECONDARY => self.secondary_package()?,
            package => package,
        };
        let package = self.packages.iter().find(|one| one.name == package)?;
        let (_, text) = package.modules.iter().find(|(own, _)| *own == name)?;
        let folder = package.name.replace('_', "-");
        let file = format!("{folder}/shaders/{name}.wesl");
        let text = replaced::text(&file).unwrap_or(text);
        Some((file, text))
    }

    /// Where the modules of the second tracer are.
    fn secondary_package(&self) -> Option<&'static str> {
        self.secondary?.split("::").next()
    }

    fn validate(&self, wgsl: &str, root: &ModulePath) -> Result<(naga::Module, ModuleInfo)> {
        let error = |span: Option<naga::Span>, message: String| {
            let at = span.and_then(naga::Span::to_range).unwrap_or(0..0);
            let (file, line) = locate::line(wgsl, at.start, root, &|path| self.find(path));
            Error::Shader {
                file,
                line,
                message,
            }
        };
        let module = naga::front::wgsl::parse_str(wgsl).map_err(|parse| {
            let notes: Vec<&str> = parse.labels().map(|(_, label)| label).collect();
            let span = parse.labels().next().map(|(span, _)| span);
            error(span, join(parse.message(), &notes))
        })?;
        let info = Validator::new(ValidationFlags::all(), Capabilities::all())
            .validate(&module)
            .map_err(|invalid| {
                let notes: Vec<&str> = invalid.spans().map(|(_, label)| label.as_str()).collect();
                // The smallest: others are what it lies in.
                let spans = invalid.spans().map(|(span, _)| *span);
                let size =
                    |span: &naga::Span| span.to_range().map_or(usize::MAX, |range| range.len());
                let span = spans.min_by_key(size);
                error(span, join(&with_causes(invalid.as_inner()), &notes))
            })?;
        Ok((module, info))
    }

    /// An error that the linker found: in a module, or in a declaration of the linked text.
    fn shader_error(&self, root: &ModulePath, error: Diagnostic<wesl::Error>) -> Error {
        let detail = &*error.detail;
        let declared = detail
            .declaration
            .as_ref()
            .map(|name| locate::unmangled(name, root));
        let module = detail.module_path.as_ref();
        let module = module.or(declared.as_ref().map(|(path, _)| path));
        let (file, text) = module
            .and_then(|path| self.find(path))
            .unwrap_or_else(|| (root.components.join("::"), ""));
        let at = match (&detail.span, &declared) {
            (Some(span), _) if detail.module_path.is_some() => Some(span.start),
            (_, Some((_, item))) => locate::declaration(text, item),
            _ => None,
        };
        Error::Shader {
            file,
            line: at.map_or(0, |at| locate::line_of(text, at)),
            message: error.error.to_string(),
        }
    }
}

impl Resolver for Linker {
    fn resolve_source<'a>(&'a self, path: &ModulePath) -> Result<Cow<'a, str>, ResolveError> {
        match self.find(path) {
            Some((_, text)) if is_secondary(path) => Ok(of_secondary(text).into()),
            Some((_, text)) => Ok(text.into()),
            None => Err(ResolveError::ModuleNotFound(
                path.clone(),
                if path.components == ["tracer"] || path.components == [SECONDARY] {
                    "this shader needs a tracer, but the linker was given none".into()
                } else {
                    "is its package given to the linker?".into()
                },
            )),
        }
    }

    fn resolve_module(&self, path: &ModulePath) -> Result<TranslationUnit, ResolveError> {
        let source = self.resolve_source(path)?;
        let mut unit: TranslationUnit = source.parse().map_err(|error| {
            Diagnostic::from(error)
                .with_module_path(path.clone(), self.display_name(path))
                .with_source(source.to_string())
        })?;
        // The path of a package would hold through which other package it was reached, which would make two of one.
        let own = match path.components.first() {
            // This crate's tracers are one module each; what they import is what shaders import.
            Some(own) if own == SECONDARY && self.secondary_package() == Some(SHADERS.name) => {
                SHADERS.name.to_owned()
            }
            own => own.cloned().unwrap_or_default(),
        };
        for path in unit
            .imports
            .iter_mut()
            .filter_map(|import| import.path.as_mut())
        {
            let (package, is_own) = match &path.origin {
                PathOrigin::Package(name) => (name.clone(), false),
                PathOrigin::Absolute => (own.clone(), true),
                PathOrigin::Relative(_) => continue,
            };
            path.origin = PathOrigin::Absolute;
            let modules = |tracer: &'static str| tracer.split("::").map(str::to_owned);
            match (self.tracer, self.secondary) {
                (Some(tracer), _) if !is_own && package == "tracer" => {
                    path.components.splice(0..0, modules(tracer));
                }
                (_, Some(tracer)) if !is_own && package == SECONDARY => {
                    path.components.splice(0..0, modules(tracer));
                    path.components[0] = SECONDARY.into();
                }
                _ => path.components.insert(0, package),
            }
        }
        Ok(unit)
    }

    fn display_name(&self, path: &ModulePath) -> Option<String> {
        self.find(path).map(|(file, _)| file)
    }
}

/// The package that stands for the second tracer.
const SECONDARY: &str = "secondary";

fn is_secondary(path: &ModulePath) -> bool {
    path.components.first().is_some_and(|own| own == SECONDARY)
}

/// A module of a tracer as it is for the second one: with bindings and flags of its own. Lines stay where they are.
fn of_secondary(text: &str) -> String {
    let text = text.replace("@group(1)", "@group(3)");
    let mut parts = text.split("@if(");
    let mut moved = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (condition, rest) = part.split_once(')').unwrap_or((part, ""));
        let name = condition.trim_start_matches('!');
        let not = &condition[..condition.len() - name.len()];
        moved.push_str(&format!("@if({not}{SECONDARY}_{name}){rest}"));
    }
    moved
}

/// A linked and valid shader.
#[derive(Clone, Debug)]
pub struct Shader {
    name: String,
    wgsl: String,
    checked: Arc<(naga::Module, ModuleInfo)>,
}

impl Shader {
    /// The module it was linked from.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The linked WGSL.
    pub fn wgsl(&self) -> &str {
        &self.wgsl
    }

    /// What it consists of, and what of that each entry point uses.
    pub(super) fn module_and_info(&self) -> (&naga::Module, &ModuleInfo) {
        (&self.checked.0, &self.checked.1)
    }

    /// Makes it known to a device.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device lacks a feature that the shader enables.
    pub fn module(&self, context: &Context) -> Result<wgpu::ShaderModule> {
        context.check(&self.name, |device| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(&self.name),
                source: wgpu::ShaderSource::Wgsl(self.wgsl.as_str().into()),
            })
        })
    }

    /// A compute pipeline of one of its entry points; `layouts` are those of the bind groups from 0 on.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device lacks a feature, the layouts do not fit the shader, or they hold more buffers
    /// than the device binds.
    pub fn compute_pipeline(
        &self,
        context: &Context,
        entry_point: &str,
        layouts: &[&wgpu::BindGroupLayout],
    ) -> Result<wgpu::ComputePipeline> {
        let module = self.module(context)?;
        let label = format!("{}, {entry_point}", self.name);
        let layouts: Vec<_> = layouts.iter().copied().map(Some).collect();
        context.check(&label, |device| {
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(&label),
                bind_group_layouts: &layouts,
                immediate_size: 0,
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(&label),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        })
    }
}

fn join(message: &str, notes: &[&str]) -> String {
    let mut text = message.to_owned();
    for note in notes.iter().filter(|note| !note.is_empty()) {
        text.push_str("; ");
        text.push_str(note);
    }
    text
}

/// An error with all its causes, in one line.
fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(": ");
        text.push_str(&error.to_string());
        cause = error.source();
    }
    text
}
