// subvolumes.py, compiled. A column of a box is searched no higher than another column of it is known to be open.

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

struct Request {
    const uint8_t *maps;  // 0 or 1, (maps, nx, ny, nz), columns in one piece
    int64_t next[3];      // from a map, along x and along y to the next [B]
    const int64_t *map_of, *low, *high;  // (boxes,), (boxes, 3) and (boxes, 3): first and last voxels, in the map
    int64_t boxes;
    int64_t *found;  // out: (boxes,)
};

extern "C" void lowest_open(const Request *asked) {
    for (int64_t k = 0; k < asked->boxes; k++) {
        const int64_t *low = asked->low + 3 * k, *high = asked->high + 3 * k;
        const uint8_t *map = asked->maps + asked->map_of[k] * asked->next[0];
        int64_t solid = high[2] + 1 - low[2];  // layers from the lowest on, so far
        for (int64_t x = low[0]; x <= high[0] && solid > 0; x++)
            for (int64_t y = low[1]; y <= high[1] && solid > 0; y++) {
                const uint8_t *column = map + x * asked->next[1] + y * asked->next[2] + low[2];
                const void *open = std::memchr(column, 0, static_cast<size_t>(solid));
                if (open) solid = static_cast<const uint8_t *>(open) - column;
            }
        asked->found[k] = low[2] + solid;
    }
}

struct BitsRequest {
    const uint8_t *maps;  // as above
    int64_t next[3];
    const int64_t *map_of, *low;  // (boxes,), and (boxes, 3): first voxels, also beyond the map
    const uint8_t *turned;        // (boxes,): whether what is written has x and y exchanged
    int64_t limits[3], size[3];   // voxels of a map, and of what is written of a box
    int64_t boxes;
    uint8_t *bits;  // out: (boxes, ⌈voxels / 8⌉), the first voxel in the highest bit; beyond the map 0
};

extern "C" void bits_in(const BitsRequest *asked) {
    const int64_t *size = asked->size, *limits = asked->limits;
    const int64_t bytes = (size[0] * size[1] * size[2] + 7) / 8;
    std::vector<uint8_t> box(static_cast<size_t>(8 * bytes));
    for (int64_t k = 0; k < asked->boxes; k++) {
        const int64_t *low = asked->low + 3 * k;
        const int a = asked->turned[k] ? 1 : 0, b = 1 - a;  // axes of the map, along those of the box
        const int64_t bottom = std::max<int64_t>(-low[2], 0), top = std::min(size[2], limits[2] - low[2]);
        const uint8_t *map = asked->maps + asked->map_of[k] * asked->next[0] + low[2] + bottom;
        std::fill(box.begin(), box.end(), uint8_t{0});
        for (int64_t i = 0; i < size[0]; i++)
            for (int64_t j = 0; j < size[1] && top > bottom; j++) {
                const int64_t u = low[a] + i, v = low[b] + j;
                if (u < 0 || u >= limits[a] || v < 0 || v >= limits[b]) continue;
                const uint8_t *column = map + u * asked->next[1 + a] + v * asked->next[1 + b];
                std::memcpy(&box[static_cast<size_t>((i * size[1] + j) * size[2] + bottom)], column,
                            static_cast<size_t>(top - bottom));
            }
        uint8_t *out = asked->bits + k * bytes;
        for (int64_t n = 0; n < bytes; n++) {
            uint64_t eight;  // of a little-endian machine: the product has bit 8 i of it at 63 - i
            std::memcpy(&eight, &box[static_cast<size_t>(8 * n)], 8);
            out[n] = static_cast<uint8_t>(eight * 0x8040201008040201u >> 56);
        }
    }
}
