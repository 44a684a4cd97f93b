#![no_main]

npsolve_fuzz::target!("network_safetensors");
