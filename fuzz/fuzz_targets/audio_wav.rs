#![no_main]

npsolve_fuzz::target!("audio_wav");
