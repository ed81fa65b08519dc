"""Cold pages, for reader.py; written from cold.md."""

import struct
import zlib

from rules import Broken, need
from vector import plane

SLOTS = 1024
PLAIN, PLAIN_TABLES = 0x8000, [256] * 4
MH, MMH, VECTOR = 1, 2, 3
# Symbols of each table behind the plain ones.
TABLES = {
    MH: [256] * 8 + [128] * 8,
    MMH: [256] * 8 + [40] * 8 + [3, 10, 2],
    VECTOR: [17] * 6 + [256] * 8 + [224] * 14 + [34, 10, 14, 50, 50, 34, 34, 50, 50, 24, 24]
    + [68] * 6 + [16] + [68] * 4,
}
WORDS = (0, 1, 2, 1)
M32, M64 = (1 << 32) - 1, (1 << 64) - 1


def most_bytes(kind):
    """Bytes that a model takes at most, as a section and as tables of 4-byte slots together."""
    tables = PLAIN_TABLES + TABLES.get(kind, [])
    return sum(4 * SLOTS + 2 * n + 2 for n in tables) + 24 * 8192 + 16


class Wrong(Exception):
    """Bytes that are no page's."""


def tell(good):
    if not good:
        raise Wrong


def signed(v, bits=32):
    v &= (1 << bits) - 1
    return v - (v >> bits - 1 << bits)


def unzigzag(z):
    return z >> 1 ^ -(z & 1)


class Model:
    """The tables of one structure: for each a list of symbol, frequency and bias by slot."""

    def __init__(self, kind, data, at):
        rule = "cold.model"
        need(len(data) >= 1 and data[0] <= (40 if kind in (MH, MMH) else 0), rule, at, "near")
        self.kind, self.near, self.tables, i = kind, data[0], [], 1
        for symbols in PLAIN_TABLES + TABLES.get(kind, []):
            symbol, slots = 0, []
            while symbol < symbols:
                need(i < len(data), rule, at, "ends early")
                first, i = data[i], i + 1
                frequency = first
                if first == 0 or first >= 128:
                    need(i < len(data), rule, at, "ends early")
                    second, i = data[i], i + 1
                    if first == 0:
                        symbol += second
                        need(second > 0 and symbol <= symbols, rule, at, "zeros")
                        continue
                    frequency = (first & 127) << 8 | second
                    need(frequency >= 128, rule, at, "frequency")
                need(len(slots) + frequency <= SLOTS, rule, at, "sum")
                slots.extend((symbol, frequency, bias) for bias in range(frequency))
                symbol += 1
            need(len(slots) in (0, SLOTS), rule, at, f"sum {len(slots)}")
            self.tables.append(slots or [(0, SLOTS, bias) for bias in range(SLOTS)])
        self.slopes, self.selectors = [], []
        if kind == VECTOR:
            for items, form in ((self.slopes, "<II"), (self.selectors, "<I")):
                need(i + 2 <= len(data), rule, at, "ends early")
                count, size = struct.unpack_from("<H", data, i)[0], struct.calcsize(form)
                i += 2
                need(count <= 8192 and i + size * count <= len(data), rule, at, f"{count} items")
                items.extend(struct.unpack_from(form, data, i + size * n) for n in range(count))
                i += size * count
        need(i == len(data), rule, at, f"{len(data) - i} bytes left")


class Decoder:
    """Symbols and bits of a page, and the words that they make."""

    def __init__(self, model, data, words):
        self.model, self.out = model, [0] * words
        tell(len(data) >= 2)
        (first,) = struct.unpack_from("<H", data)
        self.plain, count = first & PLAIN, first & PLAIN - 1
        tell(4 <= count and 2 + 2 * count <= len(data))
        numbers = struct.unpack_from(f"<{count}H", data, 2)
        self.states = [numbers[0] | numbers[1] << 16, numbers[2] | numbers[3] << 16]
        self.halves, self.taken = numbers[4:], 0
        self.stream, self.at = int.from_bytes(data[2 + 2 * count :], "little"), 0
        self.length = 8 * (len(data) - 2 - 2 * count)

    def symbol(self, table):
        state, other = self.states
        symbol, frequency, bias = self.model.tables[table][state % SLOTS]
        state = frequency * (state // SLOTS) + bias
        if state < 1 << 16:
            half = self.halves[self.taken] if self.taken < len(self.halves) else 0
            state, self.taken = state << 16 | half, self.taken + 1
        self.states = [other, state]
        return symbol

    def bits(self, count):
        value = self.stream >> self.at & (1 << count) - 1
        self.at += count
        return value

    def rest(self, length):
        return (1 << length - 1 | self.bits(length - 1)) if length else 0

    def number(self, table):
        return self.rest(self.symbol(table))

    def put(self, at, word):
        tell(0 <= at < len(self.out))
        self.out[at] |= word

    def page(self):
        if self.plain:
            for at in range(len(self.out)):
                self.out[at] = sum(self.symbol(byte) << 8 * byte for byte in range(4))
        else:
            tell(self.model.kind in TABLES)
            self.frame()
            if self.model.kind == VECTOR:
                self.vector()
            else:
                self.tree()
        left = self.length - self.at
        tell(self.states == [1 << 16] * 2 and self.taken == len(self.halves))
        tell(0 <= left < 32 and self.stream >> self.at == 0)
        return self.out

    def frame(self):
        head = self.bits(16)
        self.refs = self.bits(16) if self.bits(1) else 0
        self.root_mask, self.level = head & 255, head >> 8
        self.put(0, self.model.kind | self.root_mask << 8 | self.refs << 16)
        self.put(1, len(self.out) | self.level << 16)
        tell(self.level <= 24)

    def tree(self):
        merged, out = self.model.kind == MMH, self.out
        end, entries, values = 2, [], []
        if merged and self.root_mask == 0:
            count = self.bits(15)
            end = 3 + -(-count // 4)
            tell(end <= len(out))
            out[2] = count
            for i in range(count):
                entries.append(self.symbol(4))
                out[3 + i // 4] |= entries[-1] << 8 * (i % 4)
            entries.reverse()
        # Word of the node, whether it is empty, level of its children, their first texel in half texels.
        pending = [(0, 0, self.level, 0, 0)] if self.root_mask else []
        waiting, references, group = {}, 0, 0
        while True:
            mask = None
            node, empty, level, x, y = 0, 0, 0, 0, 0
            if end in waiting:
                mask, level = waiting[end]
            elif merged and entries and (not pending or self.symbol(4 + 8 + 8 + 2)):
                mask = entries.pop()
            elif not pending:
                break
            else:
                node, empty, level, x, y = pending.pop()
                if node == 0:
                    mask = self.root_mask
            if mask is None:
                mask = self.symbol(4 + 4 * empty + min(level, 3))
                if mask:
                    out[node] = mask | (end & 0xFFFF) << 16
                else:
                    place = self.symbol(4 + 8 + 8) if merged else 1
                    types = self.bits(8)
                    if place == 1:
                        out[node] = types | 1 << 8 | (references & 0xFFFF) << 16
                        references += 1
                    elif place == 0:
                        to = self.bits(14)
                        tell(to <= len(out))
                        waiting[to] = types, level
                        out[node] = types | to << 16
                    else:
                        dependency = self.number(4 + 8 + 8 + 1)
                        out[node] = types | (dependency + 2 & 255) << 8 | self.bits(14) << 16
                    continue
            kinds = [mask >> 2 * c & 3 for c in range(4)]
            starts = [end + sum(WORDS[k] for k in kinds[:c]) for c in range(4)]
            end += sum(WORDS[k] for k in kinds)
            tell(end <= len(out) and mask)
            group += 1
            half, below = 1 << level, max(level - 1, 0)
            for c, kind in enumerate(kinds):
                corner = x + (c & 1) * 2 * half, y + (c >> 1) * 2 * half
                if kind in (1, 2):
                    values.append((starts[c] + kind - 1, c, kind == 2, level, group, corner[0] + half, corner[1] + half))
            for c in (3, 2, 1, 0):
                if kinds[c] >= 2:
                    corner = x + (c & 1) * 2 * half, y + (c >> 1) * 2 * half
                    pending.append((starts[c], kinds[c] & 1, below, *corner))
        tell(end == len(out))
        if merged:
            for word, _, inner, level, *_ in values:
                out[word] = unzigzag(self.number(4 + 8 + 4 * inner + min(level, 3))) & M32
        else:
            self.depths(values)

    def depths(self, values):
        # Value, x, y, slope in x and y, number.
        surfaces, front, last = [(0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0)], 0, [(0, 0, 0)] * 4
        before, number = 0, 1
        for word, child, inner, level, group, x, y in values:
            symbol = self.symbol(4 + 8 + 4 * inner + before)
            other, length = symbol >> 6, symbol & 63
            value, sx, sy, gx, gy, own = surfaces[front ^ other]
            expected = value + (signed(gx * (x - sx) + gy * (y - sy), 64) >> 16)
            value = expected + unzigzag(self.rest(length)) & M32
            self.out[word] = value
            miss = length > self.model.near
            before = 3 if miss else 2 if other else int(length >= 4)
            number += 1
            own = number if miss else own
            for axis in (1, 2):
                depth, in_group, surface = last[child ^ axis]
                if in_group == group and surface == own:
                    slope = (signed(value - depth) << 16) >> level + 1
                    gx, gy = (slope, gy) if axis == 1 else (gx, slope)
            last[child] = value, group, own
            front ^= other | miss
            surfaces[front] = value, x, y, gx, gy, own

    def vector(self):
        out = self.out
        at = 4
        flags = self.bits(2)
        proofs, short = flags & 1, flags >> 1
        counts = [self.number(at + i) for i in range(6)]
        tell(max(counts) < 1 << 16)
        lines, constants, planes, splits, masks, raws = counts
        groups, entries = self.topology(at + 6)
        tell(len(groups) < 1 << 16 and entries < 1 << 16)
        palette = sum(counts[1:])
        width = max(palette - 1, 0).bit_length()
        pairs = (len(groups), entries), (width | flags << 8, lines), (constants, planes), (splits, masks), (raws, 0)
        for i, (low, high) in enumerate(pairs):
            self.put(2 + i, low | high << 16)
        up = lambda a, b: -(-a // b)  # noqa: E731
        lengths = [5 * up(len(groups), 16), up(self.refs, 2), up(entries * width, 32), up(entries * proofs, 32)]
        lengths += [(3 - short) * lines, constants, 3 * planes, splits, 2 * masks, 2 * raws]
        firsts = [7]
        for length in lengths:
            firsts.append(firsts[-1] + length)
        tell(firsts[10] <= len(out) and (raws > 0 or firsts[10] == len(out)))
        stubs = [n for n, (mask, _, _) in enumerate(groups) if n and mask == 0]
        for i, n in enumerate(stubs[: self.refs]):
            self.put(firsts[1] + i // 2, n << 16 * (i % 2))
        tell(len(stubs) == self.refs)
        starts = [0, constants, constants + planes, constants + planes + splits, palette - raws]
        self.indexes(at + 14, groups, starts, firsts, width, proofs)
        centre, at = 128 << self.level + 1, at + 28
        self.lines(at + 5, firsts[4], lines, centre, short)
        value = 0
        for i in range(constants):
            value = value + unzigzag(self.number(at)) & M32
            out[firsts[5] + i] = value
        self.planes(at + 1, firsts[6], planes, centre)
        self.splits(at + 9, firsts[7], splits, starts)
        self.masks(at + 17, firsts[8], masks, starts)
        for i in range(firsts[9], len(out)):
            out[i] = self.bits(32)

    def topology(self, table):
        most = min(len(self.out) // 5 * 16, 32767)
        groups, tables, entries, level, following, number = [], [0], 0, self.level, 1, 0
        while number < len(tables):
            if number == following:
                level, following = max(level - 1, 0), len(tables)
            block = 7 + number // 16 * 5
            if number % 16 == 0:
                self.put(block, (len(tables) - 1 & 0xFFFF | entries << 16) & M32)
            mask = self.root_mask if number == 0 else self.symbol(table + tables[number])
            self.put(block + 1 + number % 16 // 4, mask << 8 * (number % 4))
            groups.append((mask, len(tables), entries))
            for c in range(4):
                kind = mask >> 2 * c & 3
                entries += kind in (1, 2)
                if kind >= 2:
                    tables.append((kind & 1) * 4 + min(max(level - 1, 0), 3))
            tell(len(tables) <= most)
            number += 1
        return groups, entries

    def fresh(self, expected, symbol):
        """A number of the palette by its distance from the one expected in its class; the class."""
        kind, length = divmod(symbol, 16)
        d = unzigzag(self.rest(length))
        return expected[kind] + d & M32, kind, d

    def indexes(self, table, groups, starts, firsts, width, proofs):
        order, pending = [], [0]
        while pending:
            mask, below, entry = groups[pending.pop()]
            kinds = [mask >> 2 * c & 3 for c in range(4)]
            for kind in kinds:
                if kind in (1, 2):
                    order.append((entry, kind - 1))
                    entry += 1
            pending.extend(reversed(range(below, below + sum(kind >= 2 for kind in kinds))))
        following, recent, before = list(starts), [0] * 32, 0
        for node, inner in order:
            symbol = self.symbol(table + 2 * before + inner)
            told, proven = symbol >> 1, symbol & 1
            if told >= 32:
                index, kind, d = self.fresh(following, told - 32)
                if d >= 0:
                    following[kind] = index + 1 & M32
                before = 2 + kind
            else:
                index, before = recent[-1 - told], int(told > 0)
            tell(index < 1 << width)
            recent = [*recent[1:], index]
            first, shift = divmod(node * width, 32)
            self.put(firsts[2] + first, index << shift & M32)
            if shift + width > 32:
                self.put(firsts[2] + first + 1, index << shift >> 32)
            if proofs:
                self.put(firsts[3] + node // 32, proven << node % 32)

    def lines(self, table, first, count, centre, short):
        known, bits = [], 32 if short else 48
        for i in range(count):
            symbol = self.symbol(table)
            axis, ago = symbol & 1, symbol >> 1
            if ago:
                tell(ago <= i)
                m, beside = known[-ago]
                rise = 0
            else:
                m, beside = unzigzag(self.number(table + 1)) << short & M32, 0
                rise = (signed(signed(m) * centre, 64) >> 19) - (centre << 12)
            offset = unzigzag(self.number(table + 2 + (ago > 0))) - rise + beside & (1 << bits) - 1
            known.append((m, signed(offset, bits)))
            if short:
                self.out[first + 2 * i : first + 2 * i + 2] = m >> 1 | axis << 31, offset
            else:
                self.out[first + 3 * i : first + 3 * i + 3] = m, offset & M32, offset >> 32 | axis << 16

    def planes(self, table, first, count, centre):
        known, depth = [], 0
        for i in range(count):
            symbol = self.symbol(table)
            if symbol == 0:
                a = self.bits(32)
                b = self.bits(28 if a >> 31 else 25)
            elif symbol == 9:
                place = self.number(table + 1)
                tell(place < len(self.model.slopes))
                a, b = self.model.slopes[place]
            else:
                tell(symbol <= i)
                a, b = known[-symbol]
            low = 28 if a >> 31 else 25
            b &= (1 << low) - 1
            _, gx, gy, shift = plane(0, a, b)
            rise = (gx + gy) * centre >> shift
            depth = signed(depth + unzigzag(self.number(table + 2 + (1 <= symbol < 9))), 64)
            offset = depth - rise & (1 << 64 - low) - 1
            known.append((a, b))
            self.out[first + 3 * i : first + 3 * i + 3] = offset & M32, a, b | offset >> 32 << low

    def part(self, table, others, following):
        symbol = self.symbol(table)
        if symbol < 4:
            return others[symbol], 0
        found, kind, _ = self.fresh(following, symbol - 4)
        following[kind] = found + 1 & M32
        return found, 1

    def splits(self, table, first, count, starts):
        following, recent, line_next, told, last = list(starts), [0] * 8, 0, 0, (0, 0)
        for i in range(count):
            symbol = self.symbol(table + told)
            told = int(symbol < 8)
            if told:
                line = recent[symbol]
            else:
                line = line_next + unzigzag(self.rest(symbol - 8)) & M32
                line_next = line + 1 & M32
            recent = [line, *recent[:-1]]
            following[2] = starts[2] + i
            a, new = self.part(table + 2 + told, (*last, M32, M32), following)
            following[2] = starts[2] + i
            b, _ = self.part(table + 4 + 2 * new + told, (last[1], last[0], M32, M32), following)
            last = a, b
            self.out[first + i] = line & 1023 | (a & 2047) << 10 | (b & 2047) << 21

    def masks(self, table, first, count, starts):
        following, (la, lb, lc) = list(starts), (0, 0, 0)
        for i in range(count):
            symbol = self.symbol(table)
            if symbol == 15:
                rows = self.bits(32)
            else:
                place = self.rest(symbol)
                tell(place < len(self.model.selectors))
                (rows,) = self.model.selectors[place]
            third = int(rows & 0xAAAAAAAA != 0)
            a, _ = self.part(table + 1, (la, lb, lc, M32), following)
            b, _ = self.part(table + 2, (lb, la, lc, M32), following)
            c, _ = self.part(table + 4 - third, (a, lc, lb, la), following)
            la, lb, lc = a, b, c
            self.out[first + 2 * i : first + 2 * i + 2] = (a & 1023) | (b & 1023) << 10 | (c & 1023) << 20, rows


class Lazy:
    """The model of a structure, read when it is first asked for."""

    def __init__(self, container, kind, sections):
        self.container, self.kind, self.model = container, kind, None
        self.number, self.section = sections[0] if sections else (None, None)

    def get(self):
        """The model; may be broken whenever it is asked for."""
        if not self.model:
            s, at = self.section, f"section {self.number}"
            self.container.limit("allocation", s.length + most_bytes(self.kind), at)
            data = self.container.read(s.offset, s.length)
            crc = zlib.crc32(data)
            need(crc == s.crc32, "section.crc", at, f"{s.crc32:#x} stated, {crc:#x} computed")
            self.model = Model(self.kind, data, at)
        return self.model

    def whole(self, report=lambda e: None):
        """Whether there is none, or it is not broken."""
        try:
            return not self.section or bool(self.get())
        except Broken as e:
            report(e)
            return False


def decode(model, data, words, at):
    """The bytes of a page as it is queried."""
    need(model.section, "page.cold", at, "no model")
    try:
        page = Decoder(model.get(), data, words).page()
    except Wrong:
        raise Broken("page.cold", at, "not the numbers of a page") from None
    return struct.pack(f"<{words}I", *page)
