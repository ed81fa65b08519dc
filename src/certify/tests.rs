use super::testing::{Rng, add, add_box, add_hexahedron, add_tetrahedron, empty};
use super::*;
use num_bigint::BigInt;
use num_rational::Ratio;
use num_traits::{Signed, ToPrimitive, Zero};
use umbrage_format::projection::UNCOVERED;
use umbrage_writer::solid::SolidKind;

type Q = Ratio<BigInt>;

fn q(v: impl Into<BigInt>) -> Q {
    Q::from_integer(v.into())
}

/// A second, slow implementation from the definition: every line of the whole arrangement, cut into trapezoids between
/// neighbouring abscissae of crossings.
mod slow {
    use super::*;

    struct Surface {
        solid: u32,
        step: i32,
        /// z = a x + b y + c
        plane: [Q; 3],
        corners: [[i64; 2]; 3],
    }

    impl Surface {
        fn depth(&self, p: &[Q; 2]) -> Q {
            &self.plane[0] * &p[0] + &self.plane[1] * &p[1] + &self.plane[2]
        }

        fn holds(&self, p: &[Q; 2]) -> bool {
            let signs = [0, 1, 2].map(|k| {
                let (a, b) = (self.corners[k], self.corners[(k + 1) % 3]);
                let v = q(b[0] - a[0]) * (&p[1] - q(a[1])) - q(b[1] - a[1]) * (&p[0] - q(a[0]));
                v.numer().sign()
            });
            use num_bigint::Sign::*;
            signs == [Plus; 3] || signs == [Minus; 3]
        }
    }

    fn surfaces(mesh: &SnappedMesh, o: [i64; 2], side: i64) -> Vec<Surface> {
        let mut all = Vec::new();
        for (t, &solid) in mesh.triangles.iter().zip(&mesh.solid) {
            let p = t.map(|v| mesh.positions[v as usize]);
            if (0..2).any(|k| p.iter().all(|p| p[k] <= o[k]) || p.iter().all(|p| p[k] >= o[k] + side)) {
                continue;
            }
            let e = |k: usize| [0, 1, 2].map(|a| q(p[k][a] - p[0][a]));
            let (u, v) = (e(1), e(2));
            let n = [&u[1] * &v[2] - &u[2] * &v[1], &u[2] * &v[0] - &u[0] * &v[2], &u[0] * &v[1] - &u[1] * &v[0]];
            if n[2].is_zero() {
                continue;
            }
            let (a, b) = (-&n[0] / &n[2], -&n[1] / &n[2]);
            let c = q(p[0][2]) - &a * q(p[0][0]) - &b * q(p[0][1]);
            let mut put = |step, raise: i64| {
                let plane = [a.clone(), b.clone(), &c + q(raise)];
                all.push(Surface { solid, step, plane, corners: p.map(|p| [p[0], p[1]]) });
            };
            match mesh.solids[solid as usize] {
                SolidKind::Closed => put(if n[2].is_negative() { 1 } else { -1 }, 0),
                SolidKind::Sheet { thickness } => {
                    put(1, 0);
                    if !mesh.second_surface {
                        put(-1, thickness.into());
                    }
                }
            }
        }
        all
    }

    /// The surfaces that make lo and hi on the ray; the outer `None` for no event.
    fn ends<'a>(all: &'a [Surface], p: &[Q; 2], second: bool) -> Option<(&'a Surface, Option<&'a Surface>)> {
        let mut events: Vec<(Q, &Surface)> = all.iter().filter(|s| s.holds(p)).map(|s| (s.depth(p), s)).collect();
        events.sort_by(|a, b| a.0.cmp(&b.0));
        let lo = events.first()?.1;
        if second {
            return Some((lo, events.get(1).map(|e| e.1)));
        }
        for i in 0..events.len() {
            if events.get(i + 1).is_some_and(|e| e.0 == events[i].0) {
                continue;
            }
            let inside = events[..=i].iter().any(|e| {
                let same = events[..=i].iter().filter(|f| f.1.solid == e.1.solid);
                same.map(|f| f.1.step).sum::<i32>() > 0
            });
            if !inside {
                return Some((lo, Some(events[i].1)));
            }
        }
        Some((lo, None))
    }

    /// `Err(())` for an edge texel; `None` for one with too many lines to wait for.
    pub fn area(mesh: &SnappedMesh, o: [i64; 2], side: i64) -> Option<Result<Interval, ()>> {
        let all = surfaces(mesh, o, side);
        let zero = || q(0);
        let mut lines: Vec<[Q; 3]> = Vec::new();
        let mut line = |l: [Q; 3]| {
            // Scaled, so that equal lines are equal.
            let Some(lead) = l[..2].iter().find(|v| !v.is_zero()).cloned() else { return };
            let l = l.map(|v| v / &lead);
            if !lines.contains(&l) {
                lines.push(l);
            }
        };
        for v in [0, side] {
            line([q(1), zero(), -q(o[0] + v)]);
            line([zero(), q(1), -q(o[1] + v)]);
        }
        for (i, s) in all.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (s.corners[k], s.corners[(k + 1) % 3]);
                let (dx, dy) = (q(b[0] - a[0]), q(b[1] - a[1]));
                line([-&dy, dx.clone(), dy * q(a[0]) - dx * q(a[1])]);
            }
            for t in &all[..i] {
                line([0, 1, 2].map(|k| &s.plane[k] - &t.plane[k]));
            }
        }
        if lines.len() > 28 {
            return None;
        }
        let (low, high) = (q(o[0]), q(o[0] + side));
        let mut xs = vec![low.clone(), high.clone()];
        for (i, l) in lines.iter().enumerate() {
            if l[1].is_zero() {
                xs.push(-&l[2]);
            }
            for m in &lines[..i] {
                let w = &l[0] * &m[1] - &l[1] * &m[0];
                if !w.is_zero() {
                    xs.push((&l[1] * &m[2] - &l[2] * &m[1]) / w);
                }
            }
        }
        xs.retain(|x| (&low..=&high).contains(&x));
        xs.sort();
        xs.dedup();
        let (mut min, mut max): (Option<Q>, Option<Q>) = (None, None);
        let mut bare = false;
        for slab in xs.windows(2) {
            let middle = (&slab[0] + &slab[1]) / q(2);
            let y = |l: &[Q; 3], x: &Q| -(&l[0] * x + &l[2]) / &l[1];
            let mut rows: Vec<&[Q; 3]> = lines.iter().filter(|l| !l[1].is_zero()).collect();
            let (bottom, top) = (q(o[1]), q(o[1] + side));
            rows.retain(|l| (&bottom..=&top).contains(&&y(l, &middle)));
            rows.sort_by_key(|l| y(l, &middle));
            for pair in rows.windows(2) {
                let at = [middle.clone(), (y(pair[0], &middle) + y(pair[1], &middle)) / q(2)];
                let Some((lo, hi)) = ends(&all, &at, mesh.second_surface) else {
                    bare = true;
                    continue;
                };
                for x in slab {
                    for l in pair {
                        let p = [x.clone(), y(l, x)];
                        let z = lo.depth(&p);
                        min = Some(min.map_or(z.clone(), |m| m.max(z)));
                        if let Some(hi) = hi {
                            let z = hi.depth(&p);
                            max = Some(max.map_or(z.clone(), |m| m.min(z)));
                        }
                    }
                }
            }
        }
        let Some(min) = min else { return Some(Ok(Interval { min: UNCOVERED, max: UNCOVERED })) };
        let deepest = i128::from(UNCOVERED - 1);
        let min = min.ceil().to_integer().to_i128().unwrap();
        let max = max.map_or(deepest, |m| m.ceil().to_integer().to_i128().unwrap() - 1).min(deepest);
        Some(if bare || min > max { Err(()) } else { Ok(Interval { min: min as u32, max: max as u32 }) })
    }

    /// Whether a point on no surface is inside.
    pub fn inside(mesh: &SnappedMesh, p: &[Q; 2], z: &Q) -> bool {
        let all = surfaces(mesh, [0, 0], mesh.lattice.side());
        let before: Vec<&Surface> = all.iter().filter(|s| s.holds(p) && s.depth(p) < *z).collect();
        let count = |solid| before.iter().filter(|s| s.solid == solid).map(|s| s.step).sum::<i32>();
        before.iter().any(|s| count(s.solid) > 0)
    }

    /// Depths of lo and hi at a point, exact; `None` for no event.
    pub fn sample(mesh: &SnappedMesh, o: [i64; 2], side: i64, p: &[Q; 2]) -> Option<(Q, Option<Q>)> {
        let all = surfaces(mesh, o, side);
        ends(&all, p, mesh.second_surface).map(|(lo, hi)| (lo.depth(p), hi.map(|h| h.depth(p))))
    }
}

/// A random scene; in most, `coarse` puts all coordinates on multiples of a large step, so that things touch and coincide.
fn soup(seed: u64, count: usize) -> SnappedMesh {
    let mut r = Rng(seed);
    let log2 = r.within(0, 4) as u8;
    let bits = [28, 29, 30, 32][r.within(0, 3) as usize];
    let mut mesh = empty(log2, bits);
    mesh.second_surface = seed % 4 == 3;
    let side = mesh.lattice.side();
    let coarse = !seed.is_multiple_of(3);
    let texel = side >> log2;
    let point = |r: &mut Rng| {
        let (gx, gz) = if coarse { (texel / 4, 1 << 29) } else { (1, 1) };
        let xy = |r: &mut Rng| r.within(0, side / gx) * gx;
        [xy(r), xy(r), r.within(1, ((1i64 << 32) - 2) / gz) * gz]
    };
    for _ in 0..count {
        let solid = if !mesh.solids.is_empty() && r.within(0, 3) == 0 {
            let s = r.within(0, mesh.solids.len() as i64 - 1) as usize;
            if mesh.solids[s] == SolidKind::Closed { s } else { mesh.solids.len() }
        } else {
            mesh.solids.len()
        } as u32;
        let (a, b) = (point(&mut r), point(&mut r));
        let low = [0, 1, 2].map(|k| a[k].min(b[k]));
        let high = [0, 1, 2].map(|k| a[k].max(b[k]));
        match r.within(0, 5) {
            0 | 1 => {
                let flip = (solid as usize) < mesh.solids.len() && r.within(0, 1) == 0;
                add_box(&mut mesh, solid, low, high, flip);
            }
            2 => {
                // A slanted slab over much of the map.
                let z = [0; 4].map(|_| r.within(1 << 20, 1 << 31));
                let deep = if coarse { 1 << 29 } else { r.within(1, 1 << 29) };
                let corner = |i: usize| {
                    let x = if i & 1 == 1 { side } else { 0 };
                    let y = if i & 2 == 2 { side } else { 0 };
                    [x, y, z[i & 3] + if i & 4 == 4 { deep } else { 0 }]
                };
                add_hexahedron(&mut mesh, solid, [0, 1, 2, 3, 4, 5, 6, 7].map(corner), false);
            }
            3 => {
                let c = point(&mut r);
                let thickness = [0, 1, 1 << 20, 1 << 30][r.within(0, 3) as usize];
                let fresh = mesh.solids.len() as u32;
                add(&mut mesh, fresh, SolidKind::Sheet { thickness }, &[a, b, c], &[[0, 1, 2]]);
            }
            4 => {
                // A needle.
                let d = [r.within(0, 2), r.within(0, 2), r.within(1, 2)];
                let near = |p: [i64; 3], e: [i64; 3]| {
                    [(p[0] + e[0]).min(side), (p[1] + e[1]).min(side), (p[2] + e[2]).min((1 << 32) - 2)]
                };
                add_tetrahedron(&mut mesh, solid, [a, b, near(a, d), near(b, [d[1], d[2], d[0]])]);
            }
            _ => {
                let (c, d) = (point(&mut r), point(&mut r));
                add_tetrahedron(&mut mesh, solid, [a, b, c, d]);
            }
        }
    }
    // Some solids are called closed and are not.
    for _ in 0..if seed % 5 == 4 { 3 } else { 0 } {
        if mesh.triangles.len() > 1 {
            let t = r.within(0, mesh.triangles.len() as i64 - 1) as usize;
            if r.within(0, 1) == 0 {
                mesh.triangles[t].swap(1, 2);
                continue;
            }
            mesh.triangles.remove(t);
            mesh.solid.remove(t);
        }
    }
    mesh
}

/// Scenes to try: `UMBRAGE_SEEDS`, or a few hundred.
fn seeds() -> u64 {
    std::env::var("UMBRAGE_SEEDS").ok().and_then(|v| v.parse().ok()).unwrap_or(300)
}

#[test]
fn area_intervals_equal_the_slow_ones() {
    let (mut certified, mut covered, mut edge) = (0, 0, 0);
    for seed in 0..seeds() {
        let mesh = soup(seed, 1 + (seed % 3) as usize);
        let oracle = Oracle::new(&mesh);
        let mut r = Rng(seed ^ 0xabcd);
        for _ in 0..1 {
            let n = i64::from(mesh.lattice.resolution());
            let (x, y) = (r.within(0, n - 1), r.within(0, n - 1));
            let side = 1i64 << mesh.lattice.subtexel_bits;
            let truth = oracle.texel(x as u32, y as u32);
            let Some(expected) = slow::area(&mesh, [x * side, y * side], side) else { continue };
            let got = if truth.certified { Ok(truth.interval) } else { Err(()) };
            assert_eq!(got, expected, "seed {seed} texel {x} {y}");
            match got {
                Ok(i) if i.min == UNCOVERED => certified += 1,
                Ok(_) => covered += 1,
                Err(()) => edge += 1,
            }
        }
    }
    assert!(certified > 40 && covered > 40 && edge > 40, "{certified} {covered} {edge}");
}

#[test]
fn sampled_rays_stay_within_area_intervals() {
    let mut compared = 0;
    for seed in 1000..1300 {
        let mesh = soup(seed, 3);
        let oracle = Oracle::new(&mesh);
        let mut r = Rng(seed);
        let n = i64::from(mesh.lattice.resolution());
        let side = 1i64 << mesh.lattice.subtexel_bits;
        let t = [r.within(0, n - 1), r.within(0, n - 1)];
        let truth = oracle.texel(t[0] as u32, t[1] as u32);
        if !truth.certified {
            continue;
        }
        let o = t.map(|v| v * side);
        for _ in 0..30 {
            // Off the lattice, so on no edge.
            let p = o.map(|v| q(v) + Q::new(BigInt::from(r.within(1, side * 1009 - 1)), BigInt::from(1009)));
            let covered = truth.interval.min != UNCOVERED;
            let ray = slow::sample(&mesh, o, side, &p);
            assert_eq!(ray.is_some(), covered);
            if let Some((lo, hi)) = ray {
                compared += 1;
                assert!(lo <= q(truth.interval.min), "seed {seed}");
                assert!(hi.is_none_or(|h| h > q(truth.interval.max)), "seed {seed}");
            }
        }
    }
    assert!(compared > 300, "{compared}");
}

#[test]
fn filtered_answers_equal_exact_ones() {
    let mut tally = Tally::default();
    for seed in 0..seeds() {
        let mesh = soup(seed, 1 + (seed % 7) as usize);
        let oracle = Oracle::new(&mesh);
        let n = mesh.lattice.resolution();
        let truths: Vec<TexelTruth> = (0..n * n).map(|i| oracle.texel(i % n, i / n)).collect();
        let all = Region { x: 0, y: 0, width: n, height: n };
        for mode in 0..5 {
            let stored = |x: u32, y: u32| {
                let i = truths[(y * n + x) as usize].interval;
                match mode {
                    0 => i.min,
                    1 => i.max,
                    2 => i.min + (i.max - i.min) / 2,
                    3 => i.min.wrapping_sub(1),
                    _ => i.max.saturating_add(1),
                }
            };
            let got = oracle.check(all, stored);
            let wrong = |t: &&TexelTruth| mode == 3 || (mode == 4 && t.interval.max != UNCOVERED);
            assert_eq!(got.texels, u64::from(n * n));
            assert_eq!(got.wrong, truths.iter().filter(wrong).count() as u64, "seed {seed} mode {mode}");
            assert_eq!(got.certified, truths.iter().filter(|t| t.certified).count() as u64, "seed {seed}");
            assert_eq!(got.thin, truths.iter().filter(|t| t.thin).count() as u64, "seed {seed}");
            tally = tally.merge(got);
        }
        for i in [0, n * n / 2, n * n - 1] {
            let (x, y, t) = (i % n, i / n, truths[i as usize]);
            assert_eq!(oracle.accepts(x, y, t.interval.max), (true, t.certified));
            assert!(!oracle.accepts(x, y, t.interval.min - 1).0);
        }
    }
    assert!(tally.exact * 5 < tally.texels * 4 && tally.exact > 1000, "filters settle some: {tally:?}");
}

#[test]
fn strictly_inside_agrees_with_samples_around() {
    let (mut inside, mut outside, mut missed) = (0, 0, 0);
    for seed in 0..150 {
        let mesh = soup(seed * 3 + 1, 6);
        let oracle = Oracle::new(&mesh);
        let mut r = Rng(seed);
        let quarter = mesh.lattice.side() >> (mesh.lattice.log2_resolution + 2);
        for _ in 0..4 {
            let p = [0, 1].map(|_| r.within(0, mesh.lattice.side() / quarter) * quarter);
            let t = r.within(0, mesh.triangles.len() as i64 - 1) as usize;
            let d = match oracle.surface_depth(t, p) {
                Some(d) if d == Depth::whole(d.floor()) => d,
                _ => Depth::whole(r.within(1, 15) << 28),
            };
            let got = oracle.strictly_inside(p, &d);
            // Far closer to the point than anything that does not pass through it.
            let tiny = |v: i64, bits: u32| Q::new(BigInt::from(v), BigInt::from(1) << bits);
            let all_inside = (0..40).all(|_| {
                let at = p.map(|v| q(v) + tiny(r.within(-(1 << 30), 1 << 30), 150));
                let rise = tiny(r.within(-(1 << 30), 1 << 30), [146, 148, 150, 165][r.within(0, 3) as usize]);
                slow::inside(&mesh, &at, &(q(BigInt::from(d.floor())) + rise))
            });
            assert!(!got || all_inside, "seed {seed} {p:?} {d:?}");
            inside += u32::from(got);
            outside += u32::from(!got);
            missed += u32::from(!got && all_inside);
        }
    }
    // Forty samples may all miss a thin sector, but seldom do.
    assert!(inside > 30 && outside > 100 && missed * 50 < outside, "{inside} {outside} {missed}");
}
