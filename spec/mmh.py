"""Pages of kind mmh, for reader.py; written from mmh.md."""

from rules import EMPTY, INNER, LEAF, NONE, need

NODE_WORDS = (0, 1, 2, 1)
MOST_DEPENDENCIES, MOST_WORDS = 254, 16384
MODULUS = 1 << 32


def nodes(mask, start):
    """(child, type, word) of the nodes of a group."""
    for c in range(4):
        kind = mask >> 2 * c & 3
        if kind != NONE:
            yield c, kind, start
        start += NODE_WORDS[kind]


def group_words(mask):
    return sum(NODE_WORDS[mask >> 2 * c & 3] for c in range(4))


def both(a, b):
    """The room that two leave."""
    return (max(a[0], b[0]), min(a[1], b[1])) if a and b else None


class Merged:
    """A page of kind mmh whose frame has been checked."""

    def __init__(self, words, r, dependencies):
        self.words, self.dependencies, self.shared = words, dependencies, r.page_type >> 4 == 1
        self.mask, self.child_refs, self.level = words[0] >> 8 & 255, words[0] >> 16, words[1] >> 16 & 255
        # First word: mask, lowest level, whether it has one place in the map. Heights are found for shared pages.
        self.groups, self.heights = {}, {}

    def check_plain(self, r, at):
        most = 0 if self.shared else MOST_DEPENDENCIES
        need(r.page_type & 15 == 0 and r.dep_count <= most, "mmh.plain", at, r.dep_count)
        need(len(self.words) + r.dep_count <= MOST_WORDS, "mmh.plain", at, len(self.words))
        if self.shared:
            need(self.mask == 0 and self.level == 0, "mmh.root", at, self.mask)

    def entries(self, at):
        words = self.words
        n = words[2] if len(words) > 2 else 0
        good = 1 <= n <= MOST_WORDS and 1 + -(-n // 4) <= len(words) - 2
        need(good, "mmh.entries", at, n)
        masks = [words[3 + i // 4] >> 8 * (i % 4) & 255 for i in range(-(-n // 4) * 4)]
        need(all(masks[:n]) and not any(masks[n:]), "mmh.entries", at, masks)
        return masks[:n]

    def check(self, r, log2_resolution, at):
        """The rules of one page behind root group and footprint; its leaf, inner and empty nodes."""
        words, length = self.words, len(self.words)
        entries = self.entries(at) if self.shared else []
        start = 3 + -(-len(entries) // 4) if self.shared else 2
        waiting, visited, taken = {}, 0, 0
        if not self.shared:
            waiting[2] = self.mask, self.level, True
        children, used, counted, finest = set(), set(), [0, 0, 0, 0], self.level
        while start < length:
            if start in waiting:
                mask, level, alone = waiting[start]
            else:
                need(taken < len(entries), "mmh.hole", at, f"word {start}")
                mask, level, alone = waiting[start] = entries[taken], log2_resolution, False
                taken += 1
            visited += 1
            self.groups[start] = mask, level, alone
            end = start + group_words(mask)
            need(end <= length, "mmh.bounds", at, f"word {start}")
            finest = finest if self.shared else min(finest, level)
            for _, kind, word in nodes(mask, start):
                counted[kind] += 1
                if kind not in (INNER, EMPTY):
                    continue
                below, place, first = words[word] & 255, words[word] >> 8 & 255, words[word] >> 16
                need(below != 0, "mmh.childless", at, f"word {word}")
                need(level > 0, "mmh.depth", at, f"word {word}")
                if place == 0:
                    need(first > word, "mmh.order", at, f"word {word}: {first}")
                    need(first < length, "mmh.bounds", at, f"word {word}: {first}")
                    known = waiting.get(first)
                    need(known is None or known[0] == below, "mmh.overlap", at, f"word {word}: {first}")
                    waiting[first] = (
                        (below, min(known[1], level - 1), False) if known else (below, level - 1, alone)
                    )
                elif place == 1:
                    good = alone and first < self.child_refs and first not in children
                    need(good, "mmh.reference", at, f"word {word}: {first}")
                    children.add(first)
                else:
                    need(place - 2 < r.dep_count, "mmh.dependency", at, f"word {word}: {place - 2}")
                    used.add(place - 2)
            start = end
        need(visited == len(waiting), "mmh.overlap", at, f"{visited} of {len(waiting)} groups")
        need(taken == len(entries), "mmh.entries", at, f"{taken} of {len(entries)}")
        need(len(children) == self.child_refs, "mmh.reference", at, f"{len(children)} of {self.child_refs}")
        need(len(used) == r.dep_count, "mmh.dependency", at, f"{len(used)} of {r.dep_count}")
        need(finest == r.level_finest, "mmh.levels", at, finest)
        return counted[1:]

    def walk(self, r, above):
        """(word, whether it is in the depths) of values, as far as `above`, what holds above the page, is not None; what is
        said of child pages; what is said of groups in shared pages: place, mask, level, room for their rises."""
        places, rooms = {2: (r.origin_x, r.origin_y, above)}, {}
        values, said, shared = [], [None] * self.child_refs, []
        for start in sorted(self.groups):
            mask, level, alone = self.groups[start]
            x, y, above = places[start] if alone else (0, 0, None)
            room = rooms.get(start)
            for c, kind, word in nodes(mask, start):
                rise, value, below_room = self.rise(kind, word), above, None
                if alone and above is not None:
                    value = (above + rise) % MODULUS
                    if kind in (LEAF, INNER):
                        values.append((word, r.min_depth <= value <= r.max_depth))
                    below_room = r.min_depth - value, r.max_depth - value
                elif not alone and room is not None:
                    if kind in (LEAF, INNER):
                        values.append((word, room[0] <= rise <= room[1]))
                    below_room = room[0] - rise, room[1] - rise
                if kind not in (INNER, EMPTY):
                    continue
                below, place, first = self.words[word] & 255, self.words[word] >> 8 & 255, self.words[word] >> 16
                at = x + ((c & 1) << level), y + ((c >> 1) << level)
                if place == 0:
                    places[first] = (*at, value)
                    rooms[first] = both(rooms[first], below_room) if first in rooms else below_room
                elif place == 1:
                    said[first] = ((below, level - 1, *at, r.root), (r.min_depth, r.max_depth), value)
                else:
                    shared.append(((self.dependencies[place - 2], first), below, level - 1, below_room))
        return values, said, shared

    def rise(self, kind, word):
        """Signed; 0 where there is none."""
        if kind not in (LEAF, INNER):
            return 0
        value = self.words[word + (kind == INNER)]
        return value - MODULUS if value >> 31 else value

    def check_values(self, r, above, at):
        for word, good in self.walk(r, above)[0]:
            need(good, "mmh.values", at, f"word {word}")

    def links(self, r, above):
        return [] if self.shared else self.walk(r, above)[1]

    def note(self, references, r, above):
        """Adds what this page says of groups in shared pages: by ordinal and first word a mask, whether all agree on it,
        the lowest level, and the room for rises."""
        for key, mask, level, room in self.walk(r, above)[2]:
            known, agreed, lowest, before = references.get(key, (mask, True, level, None))
            room = both(before, room) if before and room else before or room
            references[key] = known, agreed and known == mask, min(lowest, level), room

    def check_references(self, references, ordinal, at):
        """A shared page against what was noted of it."""
        for start in sorted(self.groups, reverse=True):
            mask, tallest = self.groups[start][0], 0
            for _, kind, word in nodes(mask, start):
                if kind in (INNER, EMPTY):
                    tallest = max(tallest, self.heights[self.words[word] >> 16])
            self.heights[start] = tallest + 1
        rooms, bad = {}, None
        for key in [k for k in references if k[0] == ordinal]:
            mask, agreed, level, rooms[key[1]] = references.pop(key)
            found = self.groups.get(key[1], (None,))[0]
            if not (agreed and found == mask and self.heights[key[1]] <= level + 1):
                bad = f"word {key[1]}: {found}, nodes say {mask}"
        need(bad is None, "mmh.link", at, bad)
        for start in sorted(self.groups):
            room = rooms.get(start)
            for _, kind, word in nodes(self.groups[start][0], start) if room else ():
                rise = self.rise(kind, word)
                good = kind == EMPTY or room[0] <= rise <= room[1]
                need(good, "mmh.values", at, f"word {word}: {rise}")
                if kind != LEAF:
                    below, first = (room[0] - rise, room[1] - rise), self.words[word] >> 16
                    rooms[first] = both(rooms[first], below) if rooms.get(first) else below
