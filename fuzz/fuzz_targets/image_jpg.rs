#![no_main]

npsolve_fuzz::target!("image_jpg");
