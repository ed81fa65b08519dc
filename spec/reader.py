#!/usr/bin/env python3
"""Independent reader of the Umbrage container, version 1.0, written from the text beside it.

    python3 spec/reader.py check FILE... [--limit NAME=N]...
    python3 spec/reader.py texels FILE --structure NAME [--root R] < points.csv
    python3 spec/reader.py places FILE --structure NAME [--root R] < places.csv
    python3 spec/reader.py dump FILE

Read in this order: `Container` (container.md: opening), `Structure.block` and `check_record` (index), `Structure.page`
(pages, the frame), `cold.py` (cold.md), `check_mh`, `links`, `Structure.lookup` (mh.md), `mmh.py` (mmh.md), `vector.py` (vector.md),
`Container.verify` (order of checks).
Memory: the section table, the structure records, one index block, a few pages, and what parents say of pages to come.
"""

import argparse
import collections
import json
import math
import os
import struct
import sys
import zlib

sys.dont_write_bytecode = True
from rules import EMPTY, INNER, LEAF, NONE, UNCOVERED, Broken, need  # noqa: E402
import cold  # noqa: E402
from mmh import MODULUS, Merged  # noqa: E402
from vector import Vector  # noqa: E402
from xxh3 import xxh3_64  # noqa: E402

MAGIC = b"\xd5UMB\r\n\x1a\n"
FIRST_READ = 16384
NO_STRUCTURE = 0xFFFFFFFF
STRUCTURES, INDEX, PAGES, COLD = 1, 2, 3, 4
KNOWN = STRUCTURES, INDEX, PAGES, COLD
KINDS = {1: "mh", 2: "mmh", 3: "vector", 4: "mh-stack", 5: "mmh-stack", 6: "stack", 7: "quads"}
MH, MMH, VECTOR, MASKED_KINDS = 1, 2, 3, (1, 2, 3)
# guarantee of each policy, and the policies that have a parameter
POLICIES, WITH_PARAMETER = {1: 1, 2: 1, 3: 1, 4: 2, 5: 1, 6: 3, 7: 4, 8: 3}, (3,)
GUARANTEES = (1, 2, 3, 4)
LIGHT_TOLERANCE, LEAST_DETERMINANT = 2.0**-20, 2.0**-40
NODE_WORDS = (0, 1, 2, 1)
LIMITS = {"sections": 1 << 16, "structures": 1 << 14, "pages": 1 << 24, "page-bytes": 1 << 16, "allocation": 8 << 30}
CHUNK = 1 << 16
MOST_ERRORS = 100

Header = collections.namedtuple(
    "Header",
    "magic version_major version_minor header_bytes total_bytes file_id required_features optional_features "
    "alignment_log2 reserved0 section_count structure_count reserved1 crc32",
)
HEADER = struct.Struct("<8sHHIQ16sQQB3sII56sI")
Section = collections.namedtuple("Section", "kind flags structure crc32 offset length reserved")
SECTION = struct.Struct("<IIIIQQ8s")
STRUCTURE = struct.Struct("<64s18d6Q8IHBBB27s64s124sI")
BLOCK = struct.Struct("<IIIII44s")
Page = collections.namedtuple(
    "Page",
    "offset content_hash crc32 first_child origin_x origin_y min_depth max_depth stop_error origin_l root child_count "
    "hot_words cold_words dep_first dep_count log2_x log2_y log2_l level_finest level_coarsest page_type",
)
PAGE = struct.Struct("<QQIIIIIIIHHHHHHHBBBBBB")
assert (HEADER.size, SECTION.size, STRUCTURE.size, BLOCK.size, PAGE.size) == (128, 40, 512, 64, 64)


class Invalid(Exception):
    """A request that cannot be answered."""


def align(n, a):
    return (n + a - 1) // a * a


def determinant(rows):
    """Of the linear part of a map, each row divided by its largest component."""
    a, b, c = ([v / (max(map(abs, row[:3])) or 1.0) for v in row[:3]] for row in rows)
    minor = lambda i, j: b[i] * c[j] - b[j] * c[i]  # noqa: E731
    return (a[0] * minor(1, 2) - a[1] * minor(0, 2)) + a[2] * minor(0, 1)


def bound_crc(file_id, numbers, data):
    """CRC32 of file id, numbers as u32, and bytes."""
    return zlib.crc32(data, zlib.crc32(struct.pack(f"<16s{len(numbers)}I", file_id, *numbers)))


class Container:
    """An open file: header, section table and structure records have been checked."""

    def __init__(self, path, limits=LIMITS):
        self.file = open(path, "rb", buffering=0)
        self.length = os.fstat(self.file.fileno()).st_size
        self.limits = limits
        self.first = self.read(0, min(FIRST_READ, self.length))
        self.check_header()
        self.check_table()
        self.check_structures()
        self.check_first_read()

    def close(self):
        self.file.close()

    def read(self, offset, length):
        self.file.seek(offset)
        parts = []
        while length:
            part = self.file.read(length)
            if not part:
                raise OSError("the file ends early")
            parts.append(part)
            length -= len(part)
        return b"".join(parts)

    def range(self, offset, length):
        part = self.first[offset : offset + length]
        return part if len(part) == length else self.read(offset, length)

    def limit(self, name, found, where):
        need(found <= self.limits[name], f"limit.{name}", where, f"{found}, at most {self.limits[name]} are allowed")

    def check_header(self):
        first, at = self.first, "header"
        need(first[:8] == MAGIC, "header.magic", at, first[:8].hex())
        need(len(first) >= 128, "header.truncated", at, f"{len(first)} bytes")
        h = self.header = Header._make(HEADER.unpack_from(first))
        need(h.version_major == 1, "header.version", at, h.version_major)
        need(h.header_bytes == 128, "header.size", at, h.header_bytes)
        need(h.total_bytes == self.length, "header.length", at, f"{h.total_bytes} stated, {self.length} found")
        need(h.required_features == 0, "header.feature", at, hex(h.required_features))
        need(2 <= h.alignment_log2 <= 16, "header.alignment", at, h.alignment_log2)
        need(not any(h.reserved0) and not any(h.reserved1), "header.reserved", at)
        self.alignment = 1 << h.alignment_log2
        self.table_end = 128 + 40 * h.section_count
        need(self.table_end <= self.length, "header.truncated", at, f"{h.section_count} sections")
        self.limit("sections", h.section_count, at)
        self.limit("allocation", 40 * h.section_count, "section table")
        table = self.range(128, 40 * h.section_count)
        crc = zlib.crc32(table, zlib.crc32(first[:124] + bytes(4)))
        need(crc == h.crc32, "header.crc", at, f"{h.crc32:#x} stated, {crc:#x} computed")
        self.limit("structures", h.structure_count, at)
        self.sections = [Section._make(s) for s in SECTION.iter_unpack(table)]

    def check_table(self):
        end, h = self.table_end, self.header
        owners, models = {INDEX: 0, PAGES: 0}, 0
        for i, s in enumerate(self.sections):
            at = f"section record {i}"
            need(not any(s.reserved), "section.reserved", at)
            need(s.flags <= 1, "section.flags", at, s.flags)
            known = s.kind in KNOWN
            need(known or s.flags == 0, "section.unknown", at, s.kind)
            need((i == 0) == (s.kind == STRUCTURES), "section.order", at, s.kind)
            if s.kind == STRUCTURES:
                need(s.structure == NO_STRUCTURE, "section.structure", at, s.structure)
            elif s.kind == COLD:
                need(models <= s.structure < h.structure_count, "section.structure", at, s.structure)
                models = s.structure + 1
            elif known:
                need(s.structure == owners[s.kind], "section.structure", at, s.structure)
                owners[s.kind] += 1
            else:
                good = s.structure == NO_STRUCTURE or s.structure < h.structure_count
                need(good, "section.structure", at, s.structure)
            need(not known or s.kind == COLD or s.crc32 == 0, "section.crc-field", at, s.crc32)
            start = align(end, max(64, self.alignment) if s.kind == PAGES else 64)
            need(s.offset == start, "section.offset", at, f"{s.offset}, not {start}")
            need(s.length >= 1 and s.offset + s.length <= h.total_bytes, "section.length", at, s.length)
            end = s.offset + s.length
        at = "section table"
        need(end == h.total_bytes, "section.trailing", at, f"the last section ends at {end}")
        need(owners[INDEX] == h.structure_count, "section.missing", at, f"{owners[INDEX]} index sections")
        need(owners[PAGES] == h.structure_count, "section.missing", at, f"{owners[PAGES]} page sections")
        need(self.sections, "section.missing", at, "no section")
        need(self.sections[0].length == 512 * h.structure_count, "section.length", at, self.sections[0].length)

    def check_structures(self):
        section = self.sections[0]
        self.limit("allocation", section.length, "section 0")
        data = self.range(section.offset, section.length)
        index = [s for s in self.sections if s.kind == INDEX]
        pages = [s for s in self.sections if s.kind == PAGES]
        self.structures, names = [], set()
        for i in range(self.header.structure_count):
            s = Structure(self, i, data[512 * i : 512 * i + 512], index[i], pages[i])
            models = [(n, m) for n, m in enumerate(self.sections) if (m.kind, m.structure) == (COLD, i)]
            s.model = cold.Lazy(self, s.kind, models)
            need(s.name not in names, "structure.unique", s.where, s.name)
            names.add(s.name)
            self.limit("pages", s.page_count, s.where)
            found = index[i].length
            need(found == s.block_count * s.block_bytes, "index.length", s.where, found)
            self.limit("allocation", 64 * s.page_count, s.where)
            s.check_record(s.root_page, 0)
            self.structures.append(s)

    def check_first_read(self):
        end = self.table_end
        for i, s in enumerate(self.sections):
            if s.offset <= len(self.first):
                need(not any(self.first[end : s.offset]), "section.padding", f"section {i}")
            end = s.offset + s.length
        for s in self.structures:
            if s.index.offset + s.block_bytes <= len(self.first):
                s.block(0)

    def zero(self, start, end):
        return all(not any(part) for part in self.parts(start, end))

    def parts(self, start, end):
        for at in range(start, end, CHUNK):
            yield self.read(at, min(CHUNK, end - at))

    def verify(self, report):
        """Checks the whole file; each broken rule is given to `report`."""
        summary = {"structures": len(self.structures), "blocks": 0, "pages": 0, "unsupported": 0}
        end = self.table_end
        for i, s in enumerate(self.sections):
            at = f"section {i}"
            if not self.zero(end, s.offset):
                report(Broken("section.padding", at, "not zero"))
            end = s.offset + s.length
            if s.kind not in KNOWN:
                crc = 0
                for part in self.parts(s.offset, end):
                    crc = zlib.crc32(part, crc)
                if crc != s.crc32:
                    report(Broken("section.crc", at, f"{s.crc32:#x} stated, {crc:#x} computed"))
        for s in self.structures:
            s.model.whole(report)
            s.verify(report, summary)
        return summary

    def structure(self, name):
        for s in self.structures:
            if s.name == name:
                return s
        raise Invalid(f"no structure is named '{name}'; it has {', '.join(s.name for s in self.structures)}")


class Structure:
    """One structure whose record has been checked."""

    def __init__(self, container, number, data, index, pages):
        self.container, self.number, self.index = container, number, index
        self.where = at = f"structure {number}"
        file_id = container.header.file_id
        fields = STRUCTURE.unpack(data)
        name, numbers, self.counts = fields[0], fields[1:19], fields[19:25]
        self.kind, self.projection, self.policy, self.guarantee = fields[25:29]
        self.root_count, self.page_count, self.shared_pages, self.depth_guard = fields[29:33]
        self.records_per_block, self.index_block_log2, self.log2_resolution, self.subtexel_bits = fields[33:37]
        reserved0, root_page, reserved1, crc32 = fields[37:]
        self.edge_texels, self.thin_texels = self.counts[:2]
        crc = bound_crc(file_id, [number], data[:508])
        need(crc == crc32, "structure.crc", at, f"{crc32:#x} stated, {crc:#x} computed")
        try:
            self.name = name.rstrip(b"\0").decode("utf-8")
        except UnicodeDecodeError as e:
            raise Broken("structure.name", at, str(e)) from None
        need(self.name and "\0" not in self.name, "structure.name", at)
        need(self.kind in KINDS, "structure.kind", at, self.kind)
        need(self.projection == 1, "structure.projection", at, self.projection)
        need(self.policy in POLICIES, "structure.policy", at, self.policy)
        need(self.guarantee in GUARANTEES, "structure.guarantee", at, self.guarantee)
        need(self.guarantee == POLICIES[self.policy], "structure.promise", at, self.guarantee)
        need(1 <= self.root_count <= 65535, "structure.roots", at, self.root_count)
        need(self.page_count >= self.root_count + self.shared_pages, "structure.pages", at, self.page_count)
        need(12 <= self.index_block_log2 <= 16, "structure.block", at, self.index_block_log2)
        self.block_bytes = 1 << self.index_block_log2
        most = (self.block_bytes - 64) // 64
        need(1 <= self.records_per_block <= most, "structure.block", at, self.records_per_block)
        need(self.log2_resolution <= 24, "structure.resolution", at, self.log2_resolution)
        need(self.subtexel_bits <= 48 - self.log2_resolution, "structure.resolution", at, self.subtexel_bits)
        need(all(map(math.isfinite, numbers)), "structure.number", at)
        found = determinant([numbers[i : i + 4] for i in (0, 4, 8)])
        need(abs(found) >= LEAST_DETERMINANT, "structure.transform", at, found)
        x, y, z = numbers[12:15]
        squared = (x * x + y * y) + z * z
        need(abs(squared - 1) <= LIGHT_TOLERANCE, "structure.light", at, squared)
        need(0 <= numbers[16] <= self.depth_guard, "structure.guard", at, numbers[16])
        parameter = numbers[17]
        good = parameter > 0 if self.policy in WITH_PARAMETER else parameter == 0
        need(good, "structure.parameter", at, parameter)
        need(not any(reserved0) and not any(reserved1), "structure.reserved", at)
        self.root_bytes = root_page
        self.root_page = Page._make(PAGE.unpack(root_page))
        self.tree_pages = self.page_count - self.shared_pages
        self.block_count = -(-self.page_count // self.records_per_block)
        self.first, self.end = pages.offset, pages.offset + pages.length
        self.ends, self.node_counts = {}, {}
        self.blocks, self.pages, self.lists = (collections.OrderedDict() for _ in range(3))

    def check_record(self, r, ordinal):
        """What one page record alone can break."""
        at = f"record {ordinal} of the index of structure {self.number}"
        shared = ordinal >= self.tree_pages
        form = r.page_type & 15
        need(r.page_type <= 31 and form <= 1 and (r.page_type >> 4 == 1) == shared, "index.page-type", at, r.page_type)
        need(2 <= r.hot_words <= 16384, "index.words", at, r.hot_words)
        need(r.cold_words <= 16384, "index.words", at, r.cold_words)
        end = r.offset + 4 * stored_words(r)
        need(self.first <= r.offset and end <= self.end, "index.offset", at, r.offset)
        need(r.offset % self.container.alignment == 0, "index.offset", at, r.offset)
        need(ordinal != 0 or r.offset == self.first, "index.offset", at, r.offset)
        need(ordinal != self.page_count - 1 or end == self.end, "index.offset", at, r.offset)
        need(r.dep_count <= 256, "index.dependency", at, r.dep_count)
        if shared:
            nothing = (r.origin_x, r.origin_y, r.max_depth, r.stop_error, r.origin_l, r.root)
            sizes = (r.log2_x, r.log2_y, r.log2_l)
            need(not any(nothing + sizes) and r.min_depth == UNCOVERED, "index.shared", at)
            need(r.child_count == 0 and r.first_child == 0, "index.children", at, r.first_child)
        else:
            need(r.root < self.root_count, "index.root", at, r.root)
            need(r.min_depth <= r.max_depth, "index.depths", at, f"{r.min_depth} to {r.max_depth}")
            need(ordinal >= self.root_count or r.root == ordinal, "index.root", at, r.root)
            if ordinal == 0:
                need(r.first_child == self.root_count, "index.children", at, r.first_child)
            least = max(self.root_count, ordinal + 1)
            need(ordinal == 0 or least <= r.first_child <= self.tree_pages, "index.children", at, r.first_child)
            children = r.first_child + r.child_count
            need(children <= self.tree_pages, "index.children", at, children)
            need(ordinal != self.tree_pages - 1 or children == self.tree_pages, "index.children", at, children)
        side = self.log2_resolution
        axes = ((r.log2_x, r.origin_x, side), (r.log2_y, r.origin_y, side), (r.log2_l, r.origin_l, 16))
        for log2, origin, most in axes:
            good = log2 <= most and origin % (1 << log2) == 0 and origin + (1 << log2) <= 1 << most
            need(good, "index.footprint", at, f"2^{log2} from {origin}")
        need(r.level_coarsest <= side, "index.levels", at, r.level_coarsest)
        need(r.level_finest <= r.level_coarsest, "index.levels", at, r.level_finest)

    def check_follows(self, before, r, ordinal):
        """A record against the one before it."""
        at = f"record {ordinal} of the index of structure {self.number}"
        start = align(before.offset + 4 * stored_words(before), self.container.alignment)
        need(r.offset == start, "index.offset", at, f"{r.offset}, not {start}")
        first = 0 if ordinal >= self.tree_pages else before.first_child + before.child_count
        need(r.first_child == first, "index.children", at, f"{r.first_child}, not {first}")

    def block(self, number):
        """The page records of a block, read and checked when first asked for."""
        if number in self.blocks:
            return self.blocks[number]
        at = f"index block {number} of structure {self.number}"
        data = self.container.range(self.index.offset + number * self.block_bytes, self.block_bytes)
        crc32, structure, first, count, dep_count, reserved = BLOCK.unpack_from(data)
        crc = bound_crc(self.container.header.file_id, [self.number, number], data[4:])
        need(crc == crc32, "index.crc", at, f"{crc32:#x} stated, {crc:#x} computed")
        need(not any(reserved), "index.reserved", at)
        need(structure == self.number, "index.head", at, structure)
        need(first == number * self.records_per_block, "index.head", at, first)
        need(count == min(self.records_per_block, self.page_count - first), "index.head", at, count)
        lists = 64 + 64 * self.records_per_block
        need(lists + 4 * dep_count <= self.block_bytes, "index.head", at, dep_count)
        unused = data[64 + 64 * count : lists] + data[lists + 4 * dep_count :]
        need(not any(unused), "index.unused", at)
        deps = struct.unpack_from(f"<{dep_count}I", data, lists)
        records = [Page._make(r) for r in PAGE.iter_unpack(data[64 : 64 + 64 * count])]
        listed = 0
        for i, r in enumerate(records):
            ordinal = first + i
            self.check_record(r, ordinal)
            if i:
                self.check_follows(records[i - 1], r, ordinal)
            good = r.dep_first == (listed if r.dep_count else 0) and listed + r.dep_count <= dep_count
            need(good, "index.dependency", at, r.dep_first)
            least = max(self.tree_pages, ordinal + 1)
            for d in deps[listed : listed + r.dep_count]:
                need(least <= d < self.page_count, "index.dependency", at, d)
            listed += r.dep_count
        need(listed == dep_count, "index.head", at, dep_count)
        if number == 0:
            need(data[64:128] == self.root_bytes, "structure.root", at)
        if number - 1 in self.ends:
            self.check_follows(self.ends[number - 1][1], records[0], first)
        if number + 1 in self.ends:
            self.check_follows(records[-1], self.ends[number + 1][0], first + count)
        self.ends[number] = records[0], records[-1]
        keep(self.blocks, number, records, 8)
        keep(self.lists, number, deps, 8)
        return records

    def record(self, ordinal):
        if ordinal == 0:
            return self.root_page
        return self.block(ordinal // self.records_per_block)[ordinal % self.records_per_block]

    def dependencies(self, ordinal):
        number = ordinal // self.records_per_block
        r = self.block(number)[ordinal % self.records_per_block]
        return self.lists[number][r.dep_first : r.dep_first + r.dep_count]

    def page(self, ordinal, whole=False):
        """The words of a page whose bytes, frame and nodes have been checked; None for a kind without a definition."""
        if ordinal in self.pages and not whole:
            return self.pages[ordinal]
        r, at = self.record(ordinal), f"page {ordinal} of structure {self.number}"
        self.container.limit("page-bytes", 4 * max(stored_words(r), r.hot_words), at)
        data = self.container.read(r.offset, 4 * stored_words(r))
        crc = bound_crc(self.container.header.file_id, [self.number, ordinal], data)
        need(crc == r.crc32, "page.crc", at, f"{r.crc32:#x} stated, {crc:#x} computed")
        if r.cold_words:
            data = cold.decode(self.model, data, r.hot_words, at)
        if whole or r.cold_words:
            need(xxh3_64(data) == r.content_hash, "page.hash", at, hex(r.content_hash))
        words = struct.unpack(f"<{r.hot_words}I", data)
        flat = r.page_type & 15 == 1
        tag, root_mask, child_refs = words[0] & 255, words[0] >> 8 & 255, words[0] >> 16
        need(tag == (255 if flat else self.kind), "page.tag", at, tag)
        need(child_refs == r.child_count, "page.children", at, child_refs)
        need(words[1] & 0xFFFF == r.hot_words, "page.length", at, words[1] & 0xFFFF)
        need(words[1] >> 16 & 255 == r.level_coarsest, "page.level", at, words[1] >> 16 & 255)
        need(not flat or r.level_coarsest == 0, "page.level", at, r.level_coarsest)
        need(words[1] >> 24 == 0, "page.flags", at, words[1] >> 24)
        need(root_mask == 0 or (self.kind in MASKED_KINDS and not flat), "page.flags", at, root_mask)
        if self.kind not in MASKED_KINDS:
            return None
        if self.kind == MMH:
            page = Merged(words, r, self.dependencies(ordinal) if r.dep_count else ())
            page.check_plain(r, at)
        if self.kind != MMH or not page.shared:
            self.check_place(words, r, ordinal, at)
        if self.kind == MMH:
            counted = page.check(r, self.log2_resolution, at)
            if ordinal < self.root_count:
                page.check_values(r, 0, at)
        elif self.kind == MH:
            page, counted = words, self.check_mh(words, r, at)
        else:
            page = Vector(words)
            counted = page.check(r, at)
        if whole:
            self.node_counts[ordinal] = counted
        keep(self.pages, ordinal, page, 64)
        return page

    def check_place(self, words, r, ordinal, at):
        """Form, root group and footprint of a page, alike in the kinds that have a layout."""
        root_mask, root_level, kind = words[0] >> 8 & 255, words[1] >> 16 & 255, KINDS[self.kind]
        is_root = ordinal < self.root_count
        plain = self.kind == MMH or (r.page_type == 0 and r.dep_count == 0)
        need(plain, f"{kind}.plain", at, r.page_type)
        if is_root:
            good = root_mask in (LEAF, INNER) and root_level == self.log2_resolution
        else:
            good = root_mask != 0 and root_level < self.log2_resolution
        need(good, f"{kind}.root", at, f"mask {root_mask:#x}, level {root_level}")
        side = root_level if is_root else root_level + 1
        good = (r.log2_x, r.log2_y, r.log2_l, r.origin_l) == (side, side, 0, 0)
        need(good, f"{kind}.footprint", at, f"2^{r.log2_x}, light {r.origin_l}")

    @staticmethod
    def check_mh(words, r, at):
        """The words of one page of kind mh; its leaf, inner and empty nodes."""
        root_mask, child_refs, root_level = words[0] >> 8 & 255, words[0] >> 16, words[1] >> 16 & 255
        taken, referred = bytearray(len(words)), set()
        counted = [0, 0, 0, 0]
        finest, values = root_level, []
        groups = [(2, root_mask, root_level)]
        while groups:
            start, mask, level = groups.pop()
            finest = min(finest, level)
            for c in range(4):
                kind = mask >> 2 * c & 3
                for w in range(start, start + NODE_WORDS[kind]):
                    need(w < len(words), "mh.bounds", at, f"word {w}")
                    need(not taken[w], "mh.overlap", at, f"word {w}")
                    taken[w] = 1
                counted[kind] += 1
                node, start = start, start + NODE_WORDS[kind]
                if kind in (LEAF, INNER):
                    values.append(words[start - 1])
                if kind not in (INNER, EMPTY):
                    continue
                below, place, first = words[node] & 255, words[node] >> 8 & 255, words[node] >> 16
                need(place <= 1, "mh.place", at, f"word {node}: {place}")
                need(below != 0, "mh.childless", at, f"word {node}")
                need(level > 0, "mh.depth", at, f"word {node}")
                if place == 1:
                    need(first < child_refs and first not in referred, "mh.reference", at, f"word {node}: {first}")
                    referred.add(first)
                else:
                    need(first > node, "mh.order", at, f"word {node}: {first}")
                    groups.append((first, below, level - 1))
        need(sum(taken) == len(words) - 2, "mh.hole", at)
        need(len(referred) == child_refs, "mh.reference", at, f"{len(referred)} of {child_refs}")
        need(finest == r.level_finest, "mh.levels", at, finest)
        need(not values or (r.min_depth <= min(values) and max(values) <= r.max_depth), "mh.values", at)
        return counted[1:]

    def links(self, page, r, above):
        """What this page says of each child page: its frame and footprint, its root, the depths of this page, and what
        holds above it, None where that is not known: a value, or a page with an entry and its origin. `above` is what
        holds above this page."""
        if self.kind != MH:
            return page.links(r, above)
        words = page
        said = [None] * (words[0] >> 16)
        groups = [(2, words[0] >> 8 & 255, words[1] >> 16 & 255, r.origin_x, r.origin_y, above)]
        while groups:
            start, mask, level, x, y, above = groups.pop()
            for c in range(4):
                kind = mask >> 2 * c & 3
                if kind in (INNER, EMPTY):
                    word = words[start]
                    link = (word & 255, level - 1, x + ((c & 1) << level), y + ((c >> 1) << level))
                    value = words[start + 1] if kind == INNER else above
                    if word >> 8 & 1:
                        said[word >> 16] = ((*link, r.root), (r.min_depth, r.max_depth), value)
                    else:
                        groups.append((word >> 16, *link, value))
                start += NODE_WORDS[kind]
        return said

    def check_link(self, announced, page, r, at):
        """A page against what its parent says of it."""
        link, (lowest, highest), above = announced
        words, kind = page if self.kind == MH else page.words, KINDS[self.kind]
        mask = words[0] >> 8 & 255
        found = (words[1] >> 16 & 255, r.origin_x, r.origin_y, r.root)
        found = (mask, *found) if self.kind != VECTOR else found
        need(found == link, f"{kind}.link", at, f"{found}, the parent says {link}")
        within = f"{r.min_depth} to {r.max_depth}"
        good = lowest <= r.min_depth and r.max_depth <= highest
        need(good, f"{kind}.depths", at, f"{within}, the parent's are {lowest} to {highest}")
        if above is not None and any(mask >> 2 * c & 3 in (NONE, EMPTY) for c in range(4)):
            if self.kind != VECTOR:
                bounds = above, above
            else:
                owner, entry, x, y = above
                bounds = owner.bounds(entry, r.origin_x - x, r.origin_y - y, r.log2_x)
            good = r.min_depth <= bounds[0] and bounds[1] <= r.max_depth
            need(good, f"{kind}.depths", at, f"{within}, it inherits {bounds}")
        if self.kind == MMH and above is not None:
            page.check_values(r, above, at)

    def verify(self, report, summary):
        self.blocks.clear()
        said, references, end, whole = collections.deque(), {}, None, True
        nodes = [0, 0, 0] if self.kind in MASKED_KINDS else None
        self.ends = {}
        for ordinal in range(self.page_count):
            at = f"page {ordinal} of structure {self.number}"
            if ordinal % self.records_per_block == 0:
                number = ordinal // self.records_per_block
                summary["blocks"] += 1
                try:
                    self.ends = {n: ends for n, ends in self.ends.items() if n == number - 1}
                    self.block(number)
                    whole = True
                except Broken as e:
                    report(e)
                    whole = False
            if not whole:
                said = end = nodes = None
                continue
            r = self.record(ordinal)
            if end is not None and not self.container.zero(end, r.offset):
                report(Broken("page.padding", at, "not zero"))
            end = r.offset + 4 * stored_words(r)
            summary["pages"] += 1
            is_root = ordinal < self.root_count
            announced = said.popleft() if said and not is_root and ordinal < self.tree_pages else None
            try:
                # Where the model is broken its cold pages are passed over.
                passed = r.cold_words and not self.model.whole()
                words = None if passed else self.page(ordinal, whole=True)
            except Broken as e:
                report(e)
                words = None
            else:
                summary["unsupported"] += words is None and not passed
            counted = self.node_counts.pop(ordinal, None)
            nodes = [a + b for a, b in zip(nodes, counted)] if nodes and counted else None
            if said is not None:
                above = announced[2] if announced else 0 if self.kind == MMH and is_root else None
                said.extend(self.links(words, r, above) if words else [None] * r.child_count)
            if words and said is not None:
                try:
                    if self.kind == MMH and words.shared:
                        words.check_references(references, ordinal, at)
                    elif self.kind == MMH:
                        words.note(references, r, above)
                    if announced:
                        self.check_link(announced, words, r, at)
                except Broken as e:
                    report(e)
        if nodes is not None and nodes != list(self.counts[2:5]):
            report(Broken("structure.nodes", self.where, f"{self.counts[2:5]} stated, {tuple(nodes)} found"))

    def lookup(self, x, y, level, root=0):
        """(value, level of the node, page, word) at texel (x, y) of level 0."""
        if self.kind == VECTOR:
            return self.lookup_vector(x, y, level, root)
        ordinal, words = root, self.words(root)
        mask, group, l, total = words[0] >> 8 & 255, 2, self.log2_resolution, 0
        answer = (UNCOVERED, l, root, 0)
        while True:
            c = (x >> l & 1) + 2 * (y >> l & 1)
            kind = mask >> 2 * c & 3
            if kind == NONE:
                return answer
            w = group + sum(NODE_WORDS[mask >> 2 * i & 3] for i in range(c))
            if kind != EMPTY:
                value = words[w + (kind == INNER)]
                # In kind mmh it is a rise over the value above.
                total = (total + value) % MODULUS if self.kind == MMH else value
                answer = (total, l, ordinal, w)
            if kind == LEAF or l <= level:
                return answer
            mask, place, group = words[w] & 255, words[w] >> 8 & 255, words[w] >> 16
            if place == 1:
                ordinal = self.record(ordinal).first_child + group
                words = self.words(ordinal)
                mask, group = words[0] >> 8 & 255, 2
            elif place > 1:
                ordinal = self.dependencies(ordinal)[place - 2]
                words = self.words(ordinal)
            l -= 1

    def words(self, ordinal):
        page = self.page(ordinal)
        return page.words if self.kind == MMH else page

    def lookup_vector(self, x, y, level, root):
        """As `lookup`; the word is the node's number, 4 * group + c."""
        (page, *node), r = self.find(x, y, level, root)
        level = min(level, self.log2_resolution)
        px, py = (256 * (v % (1 << r.log2_x) >> level << level) + (128 << level) for v in (x, y))
        return page.value(page.indexes[page.index_of[node[2]]], px, py), *node

    def continuous(self, x, y, fx, fy, root):
        """(value, whether it is proven) at a place inside texel (x, y); only for kind vector."""
        (page, _, _, node), r = self.find(x, y, 0, root)
        index = page.index_of[node]
        proven = page.proven(index)
        px, py = (256 * (v % (1 << r.log2_x)) + (f if proven else 128) for v, f in ((x, fx), (y, fy)))
        return page.value(page.indexes[index], px, py), int(proven)

    def find(self, x, y, level, root):
        """Where the walk in kind vector ends: page, level, ordinal, node; and the page's record."""
        level = min(level, self.log2_resolution)
        ordinal, page = root, self.page(root)
        group, l, found = 0, self.log2_resolution, None
        while True:
            c = (x >> l & 1) + 2 * (y >> l & 1)
            kind = page.kinds[group] >> 2 * c & 3
            if kind == NONE:
                break
            if kind != EMPTY:
                found = page, l, ordinal, 4 * group + c
            if kind == LEAF or l <= level:
                break
            group = page.below[4 * group + c]
            if page.kinds[group] == 0:
                ordinal = self.record(ordinal).first_child + page.stubs.index(group)
                page, group = self.page(ordinal), 0
            l -= 1
        return found, self.record(found[2])


def stored_words(r):
    return r.cold_words or r.hot_words


def keep(cache, key, value, most):
    cache[key] = value
    if len(cache) > most:
        cache.popitem(last=False)


def check(path, limits):
    """The report of one file."""
    errors, summary, count = [], {}, 0
    rules = []

    def report(e):
        nonlocal count
        count += 1
        if count <= MOST_ERRORS:
            rules.append(e.rule)
            errors.append({"rule": e.rule, "where": e.where, "detail": str(e.detail)})

    container = None
    try:
        container = Container(path, limits)
        summary = container.verify(report)
    except Broken as e:
        report(e)
    finally:
        if container:
            container.close()
    return {"ok": count == 0, "file": path, "rules": rules, "faults": count, "errors": errors, **summary}


def rows(lines, names):
    """Numbers of the lines below a header that may be left out: (line, its number, numbers)."""
    for i, line in enumerate(lines, 1):
        fields = line.strip()
        if not fields or (i == 1 and fields.startswith("x")):
            continue
        try:
            numbers = tuple(map(int, fields.split(",")))
        except ValueError:
            numbers = ()
        if len(numbers) != len(names.split(",")):
            raise Invalid(f"line {i}: expected {names}, found '{fields}'")
        yield fields, i, numbers


def rooted(container, name, root, kinds):
    s = container.structure(name)
    if s.kind not in kinds:
        raise Invalid(f"structure '{name}' is of kind {KINDS[s.kind]}, which has no such lookups here")
    if not 0 <= root < s.root_count:
        raise Invalid(f"root {root}: there are {s.root_count}, counted from 0")
    return s


def places(container, name, root, lines, out):
    s = rooted(container, name, root, (VECTOR,))
    out.write("x,y,fx,fy,value,proven\n")
    side = 1 << s.log2_resolution
    for fields, i, (x, y, fx, fy) in rows(lines, "x,y,fx,fy"):
        if not (0 <= x < side and 0 <= y < side and 0 <= fx < 256 and 0 <= fy < 256):
            raise Invalid(f"line {i}: {fields} lies outside the map or its texel")
        out.write(",".join(map(str, (x, y, fx, fy, *s.continuous(x, y, fx, fy, root)))) + "\n")


def texels(container, name, root, lines, out):
    s = rooted(container, name, root, MASKED_KINDS)
    out.write("x,y,level,value,node_level,page,word\n")
    for fields, i, (x, y, level) in rows(lines, "x,y,level"):
        side = 1 << s.log2_resolution - level if 0 <= level <= s.log2_resolution else 0
        if not (0 <= x < side and 0 <= y < side):
            raise Invalid(f"line {i}: {fields} lies outside the map")
        answer = s.lookup(x << level, y << level, level, root)
        out.write(",".join(map(str, (x, y, level, *answer))) + "\n")


def dump(container, out):
    h = container.header
    out.write(f"version {h.version_major}.{h.version_minor}, {h.total_bytes} bytes, file id {h.file_id.hex()}\n")
    for i, s in enumerate(container.sections):
        names = {STRUCTURES: "structures", INDEX: "index", PAGES: "pages", COLD: "model of cold pages"}
        whose = "" if s.structure == NO_STRUCTURE else f" of structure {s.structure}"
        out.write(f"section {i}: {names.get(s.kind, f'type {s.kind}')}{whose}, {s.length} bytes from {s.offset}\n")
    for s in container.structures:
        side, (_, _, leaves, inner, empty, _) = 1 << s.log2_resolution, s.counts
        out.write(f"structure {s.number} {s.name!r}: {KINDS[s.kind]}, {s.root_count} x {side} x {side} texels, ")
        out.write(f"{s.page_count} pages ({s.shared_pages} shared), {leaves} leaf {inner} inner {empty} empty nodes, ")
        out.write(f"{s.edge_texels} edge and {s.thin_texels} thin texels\n")


def main():
    parser = argparse.ArgumentParser(description="Independent reader of the Umbrage container.")
    commands = parser.add_subparsers(dest="command", required=True)
    p = commands.add_parser("check", help="check whole files; one JSON object each")
    p.add_argument("files", nargs="+", metavar="FILE")
    p.add_argument("--limit", action="append", default=[], metavar="NAME=N", help=", ".join(LIMITS))
    for name, columns in (("texels", "x,y,level"), ("places", "x,y,fx,fy")):
        p = commands.add_parser(name, help=f"answer rows {columns} from standard input")
        p.add_argument("file", metavar="FILE")
        p.add_argument("--structure", required=True, metavar="NAME")
        p.add_argument("--root", type=int, default=0)
    p = commands.add_parser("dump", help="print a summary")
    p.add_argument("file", metavar="FILE")
    args = parser.parse_args()
    try:
        if args.command == "check":
            limits = dict(LIMITS)
            for text in args.limit:
                name, _, number = text.partition("=")
                if name not in LIMITS or not number.isdigit():
                    parser.error(f"--limit {text}: expected NAME=N with a name of {', '.join(LIMITS)}")
                limits[name] = int(number)
            good = True
            for path in args.files:
                result = check(path, limits)
                good = good and result["ok"]
                print(json.dumps(result))
            return 0 if good else 1
        container = Container(args.file)
        if args.command == "texels":
            texels(container, args.structure, args.root, sys.stdin, sys.stdout)
        elif args.command == "places":
            places(container, args.structure, args.root, sys.stdin, sys.stdout)
        else:
            dump(container, sys.stdout)
        return 0
    except Broken as e:
        print(f"reader.py: {e}", file=sys.stderr)
        return 4
    except (OSError, Invalid) as e:
        print(f"reader.py: {e}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
