//! Small files that together use every feature of the loaders.

use serde_json::{Value, json};

use super::{
    Files,
    gltf::{
        BYTE, FLOAT, Gltf, SHORT, SQUARE, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, bytes_of,
    },
    png,
};

/// All of them.
pub(crate) fn all() -> Vec<Files> {
    let scene = scene();
    vec![
        scene.glb(),
        scene.embedded(),
        scene.external(),
        geometry().glb(),
        geometry().embedded(),
        compressed().glb(),
        instanced().glb(),
        obj(),
    ]
}

const UVS: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];

/// Materials, textures, lights, cameras, animations and the extensions of all these.
pub(crate) fn scene() -> Gltf {
    let mut gltf = Gltf::new();
    gltf.json["extensionsUsed"] =
        json!(["KHR_lights_punctual", "KHR_texture_transform", "X_unknown"]);
    gltf.json["extensionsRequired"] = json!(["KHR_texture_transform"]);
    add_materials(&mut gltf);
    let positions = gltf.floats(&SQUARE);
    let normals = gltf.floats(&[[0.0, 0.0, 1.0]; 4]);
    let uvs = gltf.floats(&UVS);
    let indices = gltf.indices(&[0, 1, 2, 0, 2, 3]);
    let attributes = json!({
        "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "TEXCOORD_1": uvs
    });
    let target = json!([{ "POSITION": positions }]);
    let square = gltf.show(json!([
        { "attributes": attributes, "indices": indices, "material": 0 },
        { "attributes": attributes, "indices": indices, "material": 1, "targets": target },
        { "attributes": attributes, "mode": 1 }
    ]));
    gltf.set("nodes", square, "scale", json!([1, 2, -1]));
    let mesh = gltf.json["nodes"][square]["mesh"].clone();
    let child = gltf.add("nodes", json!({ "mesh": mesh, "name": "child", "skin": 0 }));
    gltf.add("skins", json!({ "joints": [child] }));
    let moving = gltf.node(json!({
        "name": "moving", "children": [child], "translation": [1, 2, 3], "rotation": [0, 0, 0, 1]
    }));
    add_cameras_and_lights(&mut gltf);
    add_animations(&mut gltf, moving);
    gltf
}

fn add_materials(gltf: &mut Gltf) {
    let image = gltf.view(&png());
    gltf.add(
        "images",
        json!({ "bufferView": image, "mimeType": "image/png" }),
    );
    gltf.add("images", json!({ "uri": "missing.png" }));
    gltf.add(
        "samplers",
        json!({ "magFilter": 9728, "minFilter": 9984, "wrapS": 33071, "wrapT": 33648 }),
    );
    gltf.add("textures", json!({ "source": 0, "sampler": 0 }));
    gltf.add("textures", json!({ "source": 1 }));
    let transform =
        json!({ "offset": [0.1, 0.2], "rotation": 0.5, "scale": [2, 3], "texCoord": 1 });
    let material = json!({
        "name": "all",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.6, 0.7, 1.0],
            "baseColorTexture": {
                "index": 0, "extensions": { "KHR_texture_transform": transform }
            },
            "metallicFactor": 0.5,
            "roughnessFactor": 0.25,
            "metallicRoughnessTexture": { "index": 0, "texCoord": 1 }
        },
        "normalTexture": { "index": 1 },
        "occlusionTexture": { "index": 1 },
        "emissiveFactor": [1, 0.5, 0],
        "emissiveTexture": { "index": 1 },
        "alphaMode": "MASK",
        "alphaCutoff": 0.25,
        "extensions": {
            "KHR_materials_emissive_strength": { "emissiveStrength": 4 },
            "KHR_materials_transmission": {
                "transmissionFactor": 0.5, "transmissionTexture": { "index": 0 }
            },
            "KHR_materials_ior": { "ior": 1.33 }
        }
    });
    gltf.add("materials", material);
    let unlit = json!({ "alphaMode": "BLEND", "extensions": { "KHR_materials_unlit": {} } });
    gltf.add("materials", unlit);
}

fn add_cameras_and_lights(gltf: &mut Gltf) {
    gltf.add(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }),
    );
    gltf.add(
        "cameras",
        json!({
            "type": "orthographic",
            "orthographic": { "xmag": 2, "ymag": 1.5, "znear": 0, "zfar": 9 }
        }),
    );
    gltf.node(json!({ "name": "eye", "camera": 0, "translation": [0, 0, 5] }));
    gltf.node(json!({
        "name": "plan", "camera": 1, "matrix": [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 9, 0, 1]
    }));
    gltf.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "intensity": 7, "color": [1, 0.5, 0], "range": 10, "name": "bulb" },
        { "type": "spot", "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.6 } },
        { "type": "directional", "intensity": 3 }
    ] } });
    for light in 0..3 {
        gltf.node(json!({
            "name": format!("light {light}"), "translation": [0, light, 0],
            "extensions": { "KHR_lights_punctual": { "light": light } }
        }));
    }
}

fn add_animations(gltf: &mut Gltf, node: usize) {
    let times = gltf.floats(&[[0.0], [1.0], [2.0]]);
    let translations = gltf.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]);
    // Quarter turns about z in normalised 16-bit integers.
    let half: i16 = 23170;
    let rotations = [[0, 0, 0, 32767], [0, 0, half, half], [0, 0, 32767, 0]];
    let rotations = gltf.accessor(&bytes_of(rotations.as_flattened()), SHORT, "VEC4");
    gltf.set("accessors", rotations, "normalized", json!(true));
    let scales: Vec<[f32; 3]> = (0..9).map(|i| [1.0 + i as f32 * 0.1; 3]).collect();
    let scales = gltf.floats(&scales);
    let target = |path: &str| json!({ "node": node, "path": path });
    gltf.add(
        "animations",
        json!({
            "samplers": [
                { "input": times, "output": translations },
                { "input": times, "output": rotations, "interpolation": "LINEAR" },
                { "input": times, "output": scales, "interpolation": "CUBICSPLINE" },
                { "input": times, "output": translations, "interpolation": "STEP" }
            ],
            "channels": [
                { "sampler": 0, "target": target("translation") },
                { "sampler": 1, "target": target("rotation") },
                { "sampler": 2, "target": target("scale") },
                { "sampler": 3, "target": target("translation") },
                { "sampler": 3, "target": { "path": "pointer" } }
            ]
        }),
    );
}

/// Every layout of vertices and indices.
pub(crate) fn geometry() -> Gltf {
    let mut gltf = Gltf::new();
    gltf.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    gltf.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let positions = gltf.floats(&SQUARE);
    let show = |gltf: &mut Gltf, attributes: Value, indices: Option<usize>, mode: u32| {
        let mut primitive = json!({ "attributes": attributes, "mode": mode });
        if let Some(indices) = indices {
            primitive["indices"] = json!(indices);
        }
        gltf.show(json!([primitive]))
    };
    let narrow = gltf.accessor(&[0, 1, 2, 0, 2, 3], UNSIGNED_BYTE, "SCALAR");
    let wide = gltf.accessor(&bytes_of(&[0_u32, 1, 2]), UNSIGNED_INT, "SCALAR");
    let zigzag = gltf.indices(&[0, 1, 3, 2]);
    show(&mut gltf, json!({ "POSITION": positions }), Some(narrow), 4);
    show(&mut gltf, json!({ "POSITION": positions }), Some(wide), 4);
    show(&mut gltf, json!({ "POSITION": positions }), Some(zigzag), 5);
    show(&mut gltf, json!({ "POSITION": positions }), None, 6);
    let colors = [
        255_u8, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 9, 9, 9, 9,
    ];
    let colors = gltf.accessor(&colors, UNSIGNED_BYTE, "VEC4");
    gltf.set("accessors", colors, "normalized", json!(true));
    let small = [0_i8, 0, 0, 0, 9, 0, 0, 0, 9, 9, 0, 0, 0, 9, 0, 0];
    let small = gltf.accessor(&bytes_of(&small), BYTE, "VEC3");
    let view = gltf.json["accessors"][small]["bufferView"]
        .as_u64()
        .unwrap() as usize;
    gltf.set("bufferViews", view, "byteStride", json!(4));
    gltf.set("accessors", small, "count", json!(4));
    let attributes = json!({ "POSITION": small, "COLOR_0": colors });
    show(&mut gltf, attributes, Some(narrow), 4);
    let sparse = add_sparse(&mut gltf, Some(positions));
    show(&mut gltf, json!({ "POSITION": sparse }), Some(narrow), 4);
    let sparse = add_sparse(&mut gltf, None);
    show(&mut gltf, json!({ "POSITION": sparse }), Some(narrow), 4);
    gltf
}

/// One mesh four times: at a node that rests and at one that moves, twice each.
pub(crate) fn instanced() -> Gltf {
    let mut gltf = Gltf::new();
    gltf.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let resting = gltf.square();
    let mesh = gltf.json["nodes"][resting]["mesh"].clone();
    let moving = gltf.node(json!({ "mesh": mesh, "name": "moving" }));
    let translations = gltf.floats(&[[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]]);
    let rotations = gltf.accessor(&[0, 0, 0, 127, 0, 0, 127, 0], BYTE, "VEC4");
    gltf.set("accessors", rotations, "normalized", json!(true));
    let scales = gltf.floats(&[[1.0; 3], [2.0; 3]]);
    let attributes = json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales });
    let extension = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    gltf.set("nodes", resting, "extensions", extension.clone());
    gltf.set("nodes", moving, "extensions", extension);
    let times = gltf.floats(&[[0.0], [1.0]]);
    let values = gltf.floats(&[[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]);
    gltf.add(
        "animations",
        json!({
            "samplers": [{ "input": times, "output": values }],
            "channels": [{ "sampler": 0, "target": { "node": moving, "path": "translation" } }]
        }),
    );
    gltf
}

/// A sparse accessor on top of another one's view, or of zeros.
fn add_sparse(gltf: &mut Gltf, base: Option<usize>) -> usize {
    let indices = gltf.view(&bytes_of(&[1_u16, 2]));
    let values = gltf.view(&bytes_of(&[2.0_f32, 0.0, 0.0, 2.0, 2.0, 0.0]));
    let sparse = json!({
        "count": 2,
        "indices": { "bufferView": indices, "componentType": UNSIGNED_SHORT },
        "values": { "bufferView": values }
    });
    let accessor = json!({ "componentType": FLOAT, "type": "VEC3", "count": 4, "sparse": sparse });
    let accessor = gltf.add("accessors", accessor);
    if let Some(base) = base {
        let view = gltf.json["accessors"][base]["bufferView"].clone();
        gltf.set("accessors", accessor, "bufferView", view);
    }
    accessor
}

/// A grid whose views are compressed with meshoptimizer, each with another mode and filter.
pub(crate) fn compressed() -> Gltf {
    let mut gltf = Gltf::new();
    gltf.json["extensionsUsed"] = json!(["EXT_meshopt_compression"]);
    gltf.json["extensionsRequired"] = json!(["EXT_meshopt_compression", "KHR_mesh_quantization"]);
    let (positions, triangles) = grid();
    let count = positions.len();
    let encoded = meshopt::encode_filter_exp(&positions, 20, meshopt::EncodeExpMode::SharedVector);
    let encoded = meshopt::encode_vertex_buffer(&encoded).unwrap();
    let positions = add_compressed(&mut gltf, &encoded, count, 12, "ATTRIBUTES", "EXPONENTIAL");
    let normals = vec![[0.6, 0.0, 0.8, 0.0]; count];
    let encoded = meshopt::encode_filter_oct::<i8>(&normals, 8);
    let encoded = meshopt::encode_vertex_buffer(&encoded).unwrap();
    let normals = add_compressed(&mut gltf, &encoded, count, 4, "ATTRIBUTES", "OCTAHEDRAL");
    let encoded = meshopt::encode_index_buffer(&triangles, count).unwrap();
    let indices = add_compressed(&mut gltf, &encoded, triangles.len(), 4, "TRIANGLES", "NONE");
    let accessor = |view: usize, component: u32, kind: &str, count: usize| json!({ "bufferView": view, "componentType": component, "type": kind, "count": count });
    let positions = gltf.add("accessors", accessor(positions, FLOAT, "VEC3", count));
    let normals = gltf.add("accessors", accessor(normals, BYTE, "VEC3", count));
    gltf.set("accessors", normals, "normalized", json!(true));
    let scalar = accessor(indices, UNSIGNED_INT, "SCALAR", triangles.len());
    let indices = gltf.add("accessors", scalar);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals });
    let shown = gltf.show(json!([{ "attributes": attributes, "indices": indices }]));
    let encoded = meshopt::encode_filter_quat(&[[0.0, 0.0, 0.6, 0.8]; 4], 16);
    let encoded = meshopt::encode_vertex_buffer(&encoded).unwrap();
    let rotations = add_compressed(&mut gltf, &encoded, 4, 8, "ATTRIBUTES", "QUATERNION");
    let rotations = gltf.add("accessors", accessor(rotations, SHORT, "VEC4", 4));
    gltf.set("accessors", rotations, "normalized", json!(true));
    let times = gltf.floats(&[[0.0], [1.0], [2.0], [3.0]]);
    gltf.add(
        "animations",
        json!({
            "samplers": [{ "input": times, "output": rotations }],
            "channels": [{ "sampler": 0, "target": { "node": shown, "path": "rotation" } }]
        }),
    );
    let encoded = meshopt::encode_index_sequence(&triangles, count).unwrap();
    let sequence = add_compressed(&mut gltf, &encoded, triangles.len(), 2, "INDICES", "NONE");
    let scalar = accessor(sequence, UNSIGNED_SHORT, "SCALAR", triangles.len());
    let sequence = gltf.add("accessors", scalar);
    gltf.show(json!([{ "attributes": attributes, "indices": sequence }]));
    gltf
}

/// Positions and corners of 8 × 8 squares that cover the unit square in z = 0.5.
pub(crate) fn grid() -> (Vec<[f32; 3]>, Vec<u32>) {
    let positions = (0..81)
        .map(|i| [(i % 9) as f32 * 0.125, (i / 9) as f32 * 0.125, 0.5])
        .collect();
    let triangles = (0..64)
        .map(|square| square / 8 * 9 + square % 8)
        .flat_map(|a| [a, a + 1, a + 10, a, a + 10, a + 9])
        .collect();
    (positions, triangles)
}

fn add_compressed(
    gltf: &mut Gltf,
    encoded: &[u8],
    count: usize,
    stride: usize,
    mode: &str,
    filter: &str,
) -> usize {
    let view = gltf.view(encoded);
    let source = gltf.json["bufferViews"][view].clone();
    // The uncompressed data would be in a buffer that is not there.
    let mut placeholder = json!({
        "buffer": 1,
        "byteLength": count * stride,
        "extensions": { "EXT_meshopt_compression": {
            "buffer": 0,
            "byteOffset": source["byteOffset"],
            "byteLength": encoded.len(),
            "byteStride": stride,
            "count": count,
            "mode": mode,
            "filter": filter
        } }
    });
    if mode == "ATTRIBUTES" {
        placeholder["byteStride"] = json!(stride);
    }
    gltf.add("bufferViews", placeholder)
}

/// Polygons of all kinds, materials, textures with options, vertex colours.
pub(crate) fn obj() -> Files {
    Files::one("scene.obj", OBJ)
        .and("a b.mtl", MTL)
        .and("image 1.png", png())
}

const OBJ: &str = "\u{feff}# everything
mtllib a\\ b.mtl missing.mtl
o square
v 0 0 0 1 0.5 0
v 1 0 0
v 1 1 0 0 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl red
f 1/1/1 2/2/1 \\
  3/3/1 4/4/1
g an L
usemtl mask
v 3 0 0 1\r
v 6 0 0
v 6 1 0
v 4 1 0
v 4 3 0
v 3 3 0
s 1
f -6 -5 -4 -3 -2 -1
usemtl unknown
f 1//1 2//1 3//1
f 1/1 3/3 4/9
f 1 2 77
l 1 2 3
p 1
curv 0 1 2
";

const MTL: &str = "newmtl red
Kd 0.8 0.1 0.1
Ks 0.5 0.5 0.5
Ke 1 2 3
Ns 100
Ni 1.3
d 0.5
illum 2
map_Kd -s 2 3 -o 0.5 0 -clamp on image 1.png
map_Bump image 1.png
newmtl mask
map_d image 1.png
Pr 0.3
Pm 1
";
