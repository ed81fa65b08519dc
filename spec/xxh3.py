"""XXH3, 64-bit variant, seed 0, default secret; pages have at least 8 bytes."""

import struct

SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671fcb79e64eccc0e578825ad07dccff7221b8084674f743248e"
    "e03590e6813a264c3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8a8fa763fe39c343ff9dcbbc7c70b4f1d"
    "8a51e04bcdb45931c89f7ec9d9787364eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e2b16be587d47a1fc"
    "8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)
M64 = (1 << 64) - 1
P32 = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
P64 = (0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5)


def xxh3_64(data):
    n = len(data)

    def word(b, at):
        return int.from_bytes(b[at : at + 8], "little")

    def fold(a, b):
        p = a * b
        return (p & M64) ^ (p >> 64)

    def avalanche(h):
        h = (h ^ h >> 37) * 0x165667919E3779F9 & M64
        return h ^ h >> 32

    def mix(at, key):
        return fold(word(data, at) ^ word(SECRET, key), word(data, at + 8) ^ word(SECRET, key + 8))

    if n < 4:
        raise ValueError("no page is this short")
    if n <= 8:
        h = int.from_bytes(data[-4:], "little") + (int.from_bytes(data[:4], "little") << 32)
        h ^= word(SECRET, 8) ^ word(SECRET, 16)
        rotate = lambda v, by: (v << by | v >> 64 - by) & M64  # noqa: E731
        h ^= rotate(h, 49) ^ rotate(h, 24)
        h = h * 0x9FB21C651E98DF25 & M64
        h ^= (h >> 35) + n
        h = h * 0x9FB21C651E98DF25 & M64
        return h ^ h >> 28
    if n <= 16:
        low = word(data, 0) ^ word(SECRET, 24) ^ word(SECRET, 32)
        high = word(data, n - 8) ^ word(SECRET, 40) ^ word(SECRET, 48)
        swapped = int.from_bytes(low.to_bytes(8, "little"), "big")
        return avalanche(n + swapped + high + fold(low, high) & M64)
    h = n * P64[0]
    if n <= 128:
        for i in range((n - 1) // 32 + 1):
            h += mix(16 * i, 32 * i) + mix(n - 16 * (i + 1), 32 * i + 16)
        return avalanche(h & M64)
    if n <= 240:
        for i in range(8):
            h += mix(16 * i, 16 * i)
        h = avalanche(h & M64)
        for i in range(8, n // 16):
            h += mix(16 * i, 16 * (i - 8) + 3)
        return avalanche(h + mix(n - 16, 136 - 17) & M64)
    acc = [P32[2], P64[0], P64[1], P64[2], P64[3], P32[1], P64[4], P32[0]]
    keys = [struct.unpack_from("<8Q", SECRET, 8 * i) for i in range(16)]

    def stripe(at, key):
        for i, v in enumerate(struct.unpack_from("<8Q", data, at)):
            k = v ^ key[i]
            acc[i ^ 1] = acc[i ^ 1] + v & M64
            acc[i] = acc[i] + (k & 0xFFFFFFFF) * (k >> 32) & M64

    scramble = struct.unpack_from("<8Q", SECRET, 128)
    blocks = (n - 1) // 1024
    for b in range(blocks):
        for i in range(16):
            stripe(1024 * b + 64 * i, keys[i])
        for i in range(8):
            acc[i] = (acc[i] ^ acc[i] >> 47 ^ scramble[i]) * P32[0] & M64
    for i in range((n - 1 - 1024 * blocks) // 64):
        stripe(1024 * blocks + 64 * i, keys[i])
    stripe(n - 64, struct.unpack_from("<8Q", SECRET, 121))
    h = n * P64[0]
    for i in range(4):
        h += fold(acc[2 * i] ^ word(SECRET, 11 + 16 * i), acc[2 * i + 1] ^ word(SECRET, 19 + 16 * i))
    return avalanche(h & M64)
