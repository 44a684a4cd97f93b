#![no_main]

npsolve_fuzz::target!("video_webp");
