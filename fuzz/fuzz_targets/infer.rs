#![no_main]

headway_fuzz::fuzz!("infer");
