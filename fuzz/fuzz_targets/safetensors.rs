#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| lamogen_fuzz::targets::safetensors(bytes));
