//! The program with a file on a web server.

use crate::cli::{Place, SCAN};
use crate::server::{BUSY, GONE, Server, WELL};

const CAMERA: &str = "-3,4,-5,0,0,0";

#[test]
fn a_file_on_a_server_is_dumped_verified_and_drawn_as_one_on_disk() {
    let place = Place::baked("remote");
    let server = Server::new(std::fs::read(place.0.join("scan.umb")).unwrap(), "etag: \"one\"\r\n");
    let url = server.url.as_str();
    let dumps = ["scan.umb", url].map(|file| place.fine(&["dump", file, "--json"]));
    assert_eq!(dumps[0].replace("scan.umb", "X"), dumps[1].replace(url, "X"));
    place.fine(&["verify", url]);
    for (file, picture) in [("scan.umb", "local.png"), (url, "remote.png")] {
        place.fine(&["render", SCAN, file, "--backend", "cpu", "--size", "160x90", "--camera", CAMERA, "-o", picture]);
    }
    let [local, remote] = ["local.png", "remote.png"].map(|p| std::fs::read(place.0.join(p)).unwrap());
    // So small a file comes whole in the first request of each command.
    assert_eq!((local == remote, server.count()), (true, 3));
    server.set(GONE);
    let line = place.refused(3, &["dump", url]);
    assert!(line.contains(url) && line.contains("no such file"), "{line}");
    server.set(BUSY);
    assert!(place.refused(3, &["dump", url]).contains("503"));
    server.set(WELL);
    place.fine(&["dump", url]);
}
