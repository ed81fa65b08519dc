//! Runs one input through a target: `cargo run --manifest-path tests/fuzz/Cargo.toml --example one TARGET FILE`.

fn main() -> std::io::Result<()> {
    let mut args = std::env::args().skip(1);
    let (target, file) = (args.next().unwrap_or_default(), args.next().unwrap_or_default());
    let run: fn(&[u8]) = match target.as_str() {
        "open" => umbrage_fuzz::open::run,
        "page" => umbrage_fuzz::page::run,
        "roundtrip" => umbrage_fuzz::roundtrip::run,
        "query_agrees" => umbrage_fuzz::query_agrees::run,
        "scene" => umbrage_fuzz::scene::run,
        "layers" => umbrage_fuzz::layers::run,
        "intervals" => umbrage_fuzz::intervals::run,
        _ => {
            return Err(std::io::Error::other(
                "expected open, page, roundtrip, query_agrees, scene, layers or intervals, and a file",
            ));
        }
    };
    let bytes = std::fs::read(file)?;
    if target == "intervals" {
        println!("{:?}", umbrage_fuzz::intervals::scene(&mut umbrage_fuzz::input::Input(&bytes)));
    }
    run(&bytes);
    Ok(())
}
