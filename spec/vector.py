"""Pages of kind vector, for reader.py; written from vector.md."""

from rules import INNER, EMPTY, LEAF, UNCOVERED, need


class Vector:
    """A page of kind vector whose frame has been checked."""

    def __init__(self, words):
        self.words = words
        self.child_refs, self.root_level = words[0] >> 16, words[1] >> 16 & 255

    def bits(self, word, width, n):
        """Number n of those of `width` bits packed from a word on."""
        first, shift = divmod(n * width, 32)
        value = sum(w << 32 * i for i, w in enumerate(self.words[word + first : word + first + 2]))
        return value >> shift & (1 << width) - 1

    def padding(self, word, bits, at):
        """Bits of a word from `bits` on."""
        need(self.words[word] >> bits == 0, "vector.padding", at, f"word {word}")

    def check(self, r, at):
        """The rules of one page behind form, root group and footprint; its leaf, inner and empty nodes."""
        words, n = self.words, len(self.words)
        need(n >= 7, "vector.length", at, n)
        (self.groups, self.entries), (low, lines), (constants, planes), (splits, masks), (raws, unused) = (
            (w & 0xFFFF, w >> 16) for w in words[2:7]
        )
        self.width, flags = low & 255, low >> 8
        palette = constants + planes + splits + masks + raws
        # Bit 1: lines are short.
        good = 1 <= self.groups <= 32767 and flags <= (3 if lines else 1) and unused == 0
        self.line_words = 2 if flags & 2 else 3
        good = good and self.width == max(palette - 1, 0).bit_length()
        need(good, "vector.header", at, [hex(w) for w in words[2:7]])
        # First number of each class.
        self.plane, self.split = constants, constants + planes
        self.mask, self.raw = self.split + splits, self.split + splits + masks
        up = lambda a, b: -(-a // b)  # noqa: E731
        lengths = (
            *(5 * up(self.groups, 16), up(self.child_refs, 2), up(self.entries * self.width, 32)),
            *(up(self.entries, 32) * (flags & 1), self.line_words * lines, constants, 3 * planes, splits, 2 * masks, 2 * raws),
        )
        starts = [7]
        for length in lengths:
            starts.append(starts[-1] + length)
        self.at = dict(zip("topology stubs indexes proofs lines constants planes splits masks raws heap".split(), starts))
        need(starts[-1] <= n, "vector.length", at, f"{starts[-1]} of {n} words")
        counted = self.check_topology(at)
        finest = min(l for l, kinds in zip(self.levels, self.kinds) if kinds)
        need(finest == r.level_finest, "vector.levels", at, finest)
        self.check_palette(lines, at)
        self.indexes = [self.bits(self.at["indexes"], self.width, i) for i in range(self.entries)]
        for node, i in self.index_of.items():
            need(self.indexes[i] < palette, "vector.index", at, f"node {node}: {self.indexes[i]}")
            x, y = self.squares[node // 4]
            level = self.levels[node // 4]
            x, y = x + ((node & 1) << level), y + ((node >> 1 & 1) << level)
            low, high = self.bounds(self.indexes[i], x, y, level)
            need(r.min_depth <= low and high <= r.max_depth, "vector.values", at, f"node {node}: {low} to {high}")
        for name, bits in (("indexes", self.entries * self.width), ("proofs", self.entries * (flags & 1))):
            if bits % 32:
                self.padding(self.at[name] + bits // 32, bits % 32, at)
        return counted

    def check_topology(self, at):
        """Levels, first texels, types and children of the groups, indexes of the nodes with an entry."""
        words, counted = self.words, [0, 0, 0, 0]
        children = entries = 0
        self.kinds, self.levels, self.squares = [], [self.root_level], [(0, 0)]
        self.below, self.index_of, self.stubs = {}, {}, []
        listed = [words[self.at["stubs"] + i // 2] >> 16 * (i % 2) & 0xFFFF for i in range(self.child_refs)]
        for g in range(self.groups):
            block = 7 + 5 * (g // 16)
            if g % 16 == 0:
                good = (words[block] & 0xFFFF, words[block] >> 16) == (children, entries)
                need(good, "vector.ranks", at, f"word {block}: {children}, {entries}")
            kinds = words[block + 1 + g % 16 // 4] >> 8 * (g % 4) & 255
            need(g or kinds == words[0] >> 8 & 255, "vector.root", at, hex(kinds))
            need(children >= g, "vector.order", at, f"group {g}")
            self.kinds.append(kinds)
            if kinds == 0:
                good = len(self.stubs) < len(listed) and listed[len(self.stubs)] == g
                need(good, "vector.stubs", at, f"group {g}")
                self.stubs.append(g)
                continue
            level, (x, y) = self.levels[g], self.squares[g]
            for c in range(4):
                kind = kinds >> 2 * c & 3
                counted[kind] += 1
                if kind in (LEAF, INNER):
                    self.index_of[4 * g + c] = entries
                    entries += 1
                if kind in (INNER, EMPTY):
                    need(level > 0, "vector.depth", at, f"group {g}")
                    children += 1
                    self.below[4 * g + c] = children
                    self.levels.append(level - 1)
                    self.squares.append((x + ((c & 1) << level), y + ((c >> 1) << level)))
        if self.groups % 16:
            block = 7 + 5 * (self.groups // 16)
            for i in range(4):
                self.padding(block + 1 + i, 8 * max(0, min(4, self.groups % 16 - 4 * i)), at)
        need(children == self.groups - 1, "vector.order", at, f"{children} nodes with children")
        need(entries == self.entries, "vector.header", at, f"{entries} nodes with an entry")
        need(len(self.stubs) == self.child_refs, "vector.stubs", at, f"{len(self.stubs)} stubs")
        if self.child_refs % 2:
            need(words[self.at["indexes"] - 1] >> 16 == 0, "vector.stubs", at, "behind the last")
        return counted[1:]

    def check_palette(self, lines, at):
        words, n = self.words, len(self.words)
        if lines and self.line_words == 3:
            for i in range(lines):
                need(words[self.at["lines"] + 3 * i + 2] >> 17 == 0, "vector.line", at, i)
            short = (m % 2 == 0 and abs(2 * c + 1) < 2**32 for m, c, _ in map(self.line_of, range(lines)))
            need(not all(short), "vector.line", at, "short lines in 3 words")
        for i in range(self.split - self.plane):
            first = self.at["planes"] + 3 * i
            if words[first + 1] >> 31:
                _, gx, gy, _ = plane(*words[first : first + 3])
                need(max(gx, gy) >= 2**24 or min(gx, gy) < -(2**24), "vector.plane", at, i)
        depths = {}
        for i in range(self.split, self.mask):
            line, *sides = self.split_of(i)
            good = line < lines and max(sides) < i
            need(good, "vector.split", at, i)
            depths[i] = 1 + max(depths.get(side, 0) for side in sides)
            need(depths[i] <= 4, "vector.split", at, i)
        for i in range(self.mask, self.raw):
            entries, selectors = self.mask_of(i)
            good = words[self.at["masks"] + 2 * (i - self.mask)] >> 30 == 0 and 3 not in selectors
            need(good and max(entries) < self.split, "vector.mask", at, i)
        heap = self.at["heap"]
        for i in range((heap - self.at["raws"]) // 2):
            w1 = words[self.at["raws"] + 2 * i + 1]
            width = w1 >> 16 & 63
            need(w1 >> 27 == 0 and width <= 32 and w1 & 0xFFFF == heap, "vector.raw", at, i)
            heap += -(-16 * width // 32)
            need(heap <= n, "vector.length", at, f"raw {i}")
            need(max(self.raw_of(self.raw + i)) <= UNCOVERED, "vector.raw", at, i)
            if width % 2:
                self.padding(heap - 1, 16, at)
        need(heap == n, "vector.length", at, f"{heap} of {n} words")

    def proven(self, i):
        """The proof of the node of index i."""
        return self.words[3] >> 8 & 1 == 1 and self.bits(self.at["proofs"], 1, i) == 1

    def plane_of(self, i):
        at = self.at["planes"] + 3 * (i - self.plane)
        return plane(*self.words[at : at + 3])

    def split_of(self, i):
        word = self.words[self.at["splits"] + i - self.split]
        return word & 1023, word >> 10 & 2047, word >> 21

    def mask_of(self, i):
        w0, w1 = self.words[self.at["masks"] + 2 * (i - self.mask) :][:2]
        return [w0 >> 10 * k & 1023 for k in range(3)], [w1 >> 2 * k & 3 for k in range(16)]

    def raw_of(self, i):
        base, w1 = self.words[self.at["raws"] + 2 * (i - self.raw) :][:2]
        return [base + (self.bits(w1 & 0xFFFF, w1 >> 16 & 63, k) << (w1 >> 22 & 31)) for k in range(16)]

    def line_of(self, i):
        """m, c and axis of line i."""
        first, second, *last = self.words[self.at["lines"] + self.line_words * i :][: self.line_words]
        if not last:
            return 2 * signed(first, 31), signed(second, 32), first >> 31
        return signed(first, 32), signed(last[0], 16) * 2**32 + second, last[0] >> 16 & 1

    def beyond(self, i, x, y):
        m, c, axis = self.line_of(i)
        u, t = (y, x) if axis else (x, y)
        return t * 2**12 >= c + (m * u >> 19)

    def value(self, i, x, y):
        """Value of entry i at a place."""
        cell = 4 * (y // 256 % 4) + x // 256 % 4
        if i < self.plane:
            return self.words[self.at["constants"] + i]
        if i < self.split:
            offset, gx, gy, shift = self.plane_of(i)
            return min(max(offset + (gx * x + gy * y >> shift), 0), UNCOVERED - 1)
        if i < self.mask:
            line, a, b = self.split_of(i)
            return self.value(b if self.beyond(line, x, y) else a, x, y)
        if i < self.raw:
            entries, selectors = self.mask_of(i)
            return self.value(entries[selectors[cell]], x, y)
        return self.raw_of(i)[cell]

    def bounds(self, i, x, y, level):
        """Bounds of entry i over the square of 2^level texels from texel (x, y) of the footprint on."""
        if i < self.split:
            xs, ys = ((256 * v, 256 * (v + (1 << level))) for v in (x, y))
            values = [self.value(i, px, py) for px in xs for py in ys]
        elif i < self.mask:
            values = [v for side in self.split_of(i)[1:] for v in self.bounds(side, x, y, level)]
        elif i < self.raw:
            entries, selectors = self.mask_of(i)
            values = [v for s in set(selectors) for v in self.bounds(entries[s], x, y, level)]
        else:
            values = self.raw_of(i)
        return min(values), max(values)

    def links(self, r, above):
        """As `Structure.links`: what holds above a child page is an entry with its page and that page's origin."""
        inherited = {0: above}
        for g in range(self.groups):
            for c in range(4):
                node = 4 * g + c
                if node in self.below:
                    own = self.index_of.get(node)
                    own = None if own is None else (self, self.indexes[own], r.origin_x, r.origin_y)
                    inherited[self.below[node]] = own or inherited[g]
        said = []
        for g in self.stubs:
            x, y = self.squares[g]
            link = (self.levels[g], r.origin_x + x, r.origin_y + y, r.root)
            said.append((link, (r.min_depth, r.max_depth), inherited[g]))
        return said


def plane(o0, w1, w2):
    """Offset, gx, gy and shift of a plane's words."""
    if w1 >> 31:
        gx = w1 & (1 << 26) - 1 | (w2 >> 27 & 1) << 26
        return signed(w2 >> 28, 4) * 2**32 + o0, signed(gx, 27), signed(w2, 27), (w1 >> 26 & 31) + 8
    return signed(w2 >> 25, 7) * 2**32 + o0, signed(w1, 25), signed(w2, 25), w1 >> 25 & 63


def signed(n, bits):
    """The low bits of a number as two's complement."""
    n &= (1 << bits) - 1
    return n - (n >> bits - 1 << bits)
