#![no_main]

npsolve_fuzz::target!("volume_npy");
