//! Compiles `farm.proto` without protoc.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=proto/farm.proto");
    let descriptors = protox::compile(["proto/farm.proto"], ["proto"])?;
    // Comments of the specification are prose, not rustdoc.
    tonic_prost_build::configure()
        .bytes(".tessera.farm.v1.TileDone.pixels")
        .bytes(".tessera.farm.v1.ScenePiece.data")
        .disable_comments(["."])
        .compile_fds(descriptors)?;
    Ok(())
}
