#![no_main]

npsolve_fuzz::target!("light_npy");
