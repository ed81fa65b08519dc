#!/usr/bin/env python3
"""Filters over the lookups of reader.py; written from filter.md.

    python3 spec/filter.py pcf FILE --structure NAME [--root R] < receivers.csv
    python3 spec/filter.py hierarchical FILE --structure NAME [--root R] < receivers.csv
    python3 spec/filter.py trilinear FILE --structure NAME [--root R] < receivers.csv

Rows are x,y,depth,gx,gy,side and a level (pcf) or a level of detail in 1/256 (the others).
"""

import argparse
import sys

sys.dont_write_bytecode = True
from reader import MASKED_KINDS, Broken, Container, Invalid, rooted, rows  # noqa: E402
from rules import UNCOVERED  # noqa: E402

MAX_SIDE = 21


def outside(s, x, y):
    return x >> s.log2_resolution != 0 or y >> s.log2_resolution != 0


def pcf(s, root, x, y, depth, gx, gy, side, level):
    """(lit, taps, whether the receiver lies in the map)."""
    side, level = min(max(side, 1), MAX_SIDE), min(level, s.log2_resolution)
    if outside(s, x, y):
        return side * side, side * side, 0
    size = 1 << level
    lit = 0
    for v in range((y >> level) - side // 2, (y >> level) - side // 2 + side):
        for u in range((x >> level) - side // 2, (x >> level) - side // 2 + side):
            if not (0 <= u << level < 1 << s.log2_resolution and 0 <= v << level < 1 << s.log2_resolution):
                lit += 1
                continue
            value = s.lookup(u << level, v << level, level, root)[0]
            # A plane is least at a corner.
            corners = ((u * size + a, v * size + b) for a in (0, size - 1) for b in (0, size - 1))
            nearest = 16 * depth + min(gx * (a - x) + gy * (b - y) for a, b in corners)
            lit += value == UNCOVERED or nearest <= 16 * value
    return lit, side * side, 1


def hierarchical(s, root, x, y, depth, gx, gy, side, lod):
    return pcf(s, root, x, y, depth, gx, gy, side, (lod + 128) // 256)


def trilinear(s, root, x, y, depth, gx, gy, side, lod):
    level, part = divmod(lod, 256)
    lit, taps, inside = pcf(s, root, x, y, depth, gx, gy, side, level)
    if part and level < s.log2_resolution:
        lit = (256 - part) * lit + part * pcf(s, root, x, y, depth, gx, gy, side, level + 1)[0]
    else:
        lit *= 256
    return lit, 256 * taps, inside


FILTERS = {"pcf": (pcf, "level"), "hierarchical": (hierarchical, "lod"), "trilinear": (trilinear, "lod")}


def main():
    parser = argparse.ArgumentParser(description="Filters over the independent reader of the Umbrage container.")
    parser.add_argument("filter", choices=FILTERS)
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--structure", required=True, metavar="NAME")
    parser.add_argument("--root", type=int, default=0)
    args = parser.parse_args()
    answer, last = FILTERS[args.filter]
    columns = f"x,y,depth,gx,gy,side,{last}"
    try:
        container = Container(args.file)
        s = rooted(container, args.structure, args.root, MASKED_KINDS)
        sys.stdout.write(columns + ",lit,taps,inside\n")
        for fields, i, row in rows(sys.stdin, columns):
            x, y, depth, gx, gy, side, level = row
            unsigned = all(0 <= n < 1 << 32 for n in (x, y, depth, side, level))
            if not unsigned or not all(-(1 << 31) <= g < 1 << 31 for g in (gx, gy)):
                raise Invalid(f"line {i}: {fields} has a number that is not of 32 bits")
            sys.stdout.write(fields + "," + ",".join(map(str, answer(s, args.root, *row))) + "\n")
        return 0
    except Broken as e:
        print(f"filter.py: {e}", file=sys.stderr)
        return 4
    except (OSError, Invalid) as e:
        print(f"filter.py: {e}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
