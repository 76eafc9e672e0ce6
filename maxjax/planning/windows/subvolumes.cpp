// subvolumes.py, compiled: a column of a box is searched no higher than another column of it is known to be open.

#include <cstdint>
#include <cstring>

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
