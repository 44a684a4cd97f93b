#![no_main]

npsolve_fuzz::target!("mesh_glb");
