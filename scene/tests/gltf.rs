//! Every feature of glTF that is read, on files made here.
#![cfg(feature = "gltf")]

mod support;
