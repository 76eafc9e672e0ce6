// The verdicts of verifier.py, compiled: the same rules by the same float64 operations in the same order, path by path.
//
// Contacts, parts and pieces are those of contacts.py, exemptions.py and clearance.py to the bit, and so are verdicts.
// What differs is the search for the nearest voxel, which reaches the same minimum: tiles of 4 x 4 x 8 voxels in
// shells around a piece, nearest shell first, none of them beyond the least distance so far; after a few shells, in
// regions of 8 x 8 x 8 tiles. Whether one holds anything is looked up when it is first asked for, so that a call reads
// no more of a map than lies around its paths.
//
// Every index is checked before it is used, and every cast is of a number that is known to be small: points of paths
// that leave the map, or are not finite, are never made an index of.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <exception>
#include <limits>
#include <vector>

struct Verdict {
    double length, clearance, cruise_clearance, nearest[3], cruise_nearest[3];
    int64_t first_hit[3];
    uint8_t ok, inside, finite, too_near;
};

struct Request {
    const double *points;      // (paths, width, 3) [m]
    const int64_t *counts;     // of points, 1 to width
    const int64_t *map_of;     // of each path, 0 to maps - 1
    const double *exemptions;  // (paths, 2) [m]
    const uint8_t *occupied, *ground, *blocked;  // 0 or 1, (nx, ny, nz) of the first map; blocked: or null
    int64_t next_occupied, next_ground, next_blocked;  // from a map to the next [B]; 0: all are one
    int64_t paths, width, maps, shape[3];
    double origin[3], spacing, radius;  // radius: [voxels]
    double tolerance, allowed, cruise;  // [voxels]
    Verdict *verdicts;                  // out
    double *clearance_at;               // out: (paths, width) [m]
};

namespace {
constexpr double INF = std::numeric_limits<double>::infinity(), NOT = std::numeric_limits<double>::quiet_NaN();
constexpr int ZONES = 3;
constexpr int64_t WIDE = 4, TALL = 8, TILE[3] = {WIDE, WIDE, TALL};  // TALL: voxels, and so bytes, in a word
constexpr int64_t EACH = 8, REGION[3] = {EACH * WIDE, EACH * WIDE, EACH * TALL}, SHELLS = 5;  // of tiles, at first
constexpr double PIECE = 4.0, SLACK = 1e-6;  // as in clearance.py; SLACK also covers what triangle inequalities round

struct Vec {
    double at[3];
    double &operator[](int k) { return at[k]; }
    double operator[](int k) const { return at[k]; }
};
struct Voxel { int64_t at[3]; };
struct Part { Vec start, step; int zone, held; };  // held: bit e is set inside the exemption of end e

// As NumPy's minimum and maximum, of numbers.
double lesser(double a, double b) { return a < b ? a : b; }
double larger(double a, double b) { return a > b ? a : b; }
double unit(double t) { return t > 0 ? (t < 1 ? t : 1.0) : (t == t ? 0.0 : 1.0); }  // in [0, 1]; NaN, sorted last, is 1
double dot(const Vec &a, const Vec &b) { return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]; }
Vec along(const Vec &a, double t, const Vec &d) { return {{a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]}}; }

template <int N> void sort(double (&t)[N]) {  // by insertion: no number is out of order for it, not even NaN
    for (int i = 1; i < N; ++i) {
        const double x = t[i];
        int j = i;
        for (; j > 0 && t[j - 1] > x; --j) t[j] = t[j - 1];
        t[j] = x;
    }
}

// Squared distance from a + t d to a closed cube, and a point that has it: `_squared_distance` of clearance.py.
double squared_distance(const Vec &a, const Vec &d, const Voxel &voxel, Vec &point) {
    double low[3], high[3], t[8];
    t[0] = 0.0, t[7] = 1.0;
    for (int k = 0; k < 3; ++k) {
        low[k] = double(voxel.at[k]), high[k] = double(voxel.at[k]) + 1.0;
        const double speed = d[k] == 0 ? 1.0 : d[k];
        t[1 + k] = unit((low[k] - a[k]) / speed), t[4 + k] = unit((high[k] - a[k]) / speed);
    }
    sort(t);
    const auto outside = [&](double time) {
        Vec u = along(a, time, d);
        for (int k = 0; k < 3; ++k) u[k] -= lesser(larger(u[k], low[k]), high[k]);
        return u;
    };
    double slope[8];
    int right = 0;
    for (int m = 0; m < 8; ++m) {
        slope[m] = dot(outside(t[m]), d);
        right += slope[m] < 0;
    }
    right = right < 1 ? 1 : right > 7 ? 7 : right;
    const double rise = slope[right] - slope[right - 1];
    const double weight = rise > 0 ? -slope[right - 1] / rise : 0.0;
    const double best = t[right - 1] + unit(weight) * (t[right] - t[right - 1]);
    const Vec vector = outside(best);
    point = along(a, best, d);
    return dot(vector, vector);
}

using Index = int64_t[3];

// The voxels of one map from which distance is measured, found by their gap to a box.
class Held {
    const uint8_t *occupied = nullptr, *ground = nullptr;
    const int64_t *shape;
    Index tiles, regions;  // how many there are along each axis
    enum State : uint8_t { UNKNOWN, NOTHING, SOME };
    std::vector<uint8_t> of_tiles, of_regions;

    // The voxels of a column of a tile, those beyond the map taken for free; in the machine's own order of bytes.
    uint64_t word(const uint8_t *volume, int64_t x, int64_t y, int64_t z) const {
        uint64_t bytes = 0;
        const uint8_t *from = volume + ((x * shape[1] + y) * shape[2] + z);
        if (shape[2] - z >= TALL) std::memcpy(&bytes, from, TALL);
        else std::memcpy(&bytes, from, size_t(shape[2] - z));
        return bytes;
    }
    uint64_t held(int64_t x, int64_t y, int64_t z) const {
        const uint64_t bytes = word(occupied, x, y, z);
        return bytes ? bytes & ~word(ground, x, y, z) : 0;
    }
    bool tile_holds_some(const Index &tile) {
        uint8_t &state = of_tiles[size_t((tile[0] * tiles[1] + tile[1]) * tiles[2] + tile[2])];
        if (state != UNKNOWN) return state == SOME;
        const int64_t x = WIDE * tile[0], y = WIDE * tile[1], z = TALL * tile[2];
        const int64_t x_end = std::min(x + WIDE, shape[0]), y_end = std::min(y + WIDE, shape[1]);
        uint64_t any = 0, bytes = 0;
        for (int64_t i = x; i < x_end; ++i)  // without a branch, all are fetched at once
            for (int64_t j = y; j < y_end; ++j) any |= word(occupied, i, j, z);
        if (any)
            for (int64_t i = x; i < x_end; ++i)
                for (int64_t j = y; j < y_end; ++j) bytes |= held(i, j, z);
        state = bytes ? SOME : NOTHING;
        return bytes;
    }
    // Visit the tiles of a region, until a visit says that it is enough.
    template <class Visit> bool any_tile(const Index &region, Visit &&visit) const {
        Index end, tile;
        for (int k = 0; k < 3; ++k) end[k] = std::min(EACH * (region[k] + 1), tiles[k]);
        for (tile[0] = EACH * region[0]; tile[0] < end[0]; ++tile[0])
            for (tile[1] = EACH * region[1]; tile[1] < end[1]; ++tile[1])
                for (tile[2] = EACH * region[2]; tile[2] < end[2]; ++tile[2])
                    if (visit(tile)) return true;
        return false;
    }
    bool region_holds_some(const Index &region) {
        uint8_t &state = of_regions[size_t((region[0] * regions[1] + region[1]) * regions[2] + region[2])];
        if (state == UNKNOWN)
            state = any_tile(region, [&](const Index &tile) { return tile_holds_some(tile); }) ? SOME : NOTHING;
        return state == SOME;
    }
    // Squared gap, along one axis, between `size` voxels from `first` on and the box.
    static double gap(int64_t first, int64_t size, double low, double high) {
        const double g = larger(larger(double(first) - high, low - double(first + size)), 0.0);
        return g * g;
    }
    static double gap(const Index &cell, const Index &size, const Vec &low, const Vec &high) {
        double g = 0.0;
        for (int k = 0; k < 3; ++k) g += gap(size[k] * cell[k], size[k], low[k], high[k]);
        return g;
    }
    template <class Visit>
    void open(const Index &tile, const Vec &low, const Vec &high, const double &limit, Visit &&visit) const {
        const int64_t x = WIDE * tile[0], y = WIDE * tile[1], z = TALL * tile[2];
        const bool down = double(x) + 0.5 * WIDE < low[0], left = double(y) + 0.5 * WIDE < low[1];  // near ones first
        for (int64_t i = 0; i < WIDE; ++i) {
            const int64_t vx = down ? x + WIDE - 1 - i : x + i;
            const double gx = gap(vx, 1, low[0], high[0]);
            if (vx >= shape[0] || gx > limit) continue;
            for (int64_t j = 0; j < WIDE; ++j) {
                const int64_t vy = left ? y + WIDE - 1 - j : y + j;
                const double gxy = gx + gap(vy, 1, low[1], high[1]);
                if (vy >= shape[1] || gxy > limit) continue;
                const uint64_t column = held(vx, vy, z);
                if (!column) continue;
                uint8_t bytes[TALL];
                std::memcpy(bytes, &column, TALL);
                for (int64_t k = 0; k < TALL; ++k) {
                    if (!bytes[k]) continue;
                    const double g = gxy + gap(z + k, 1, low[2], high[2]);
                    if (g <= limit) visit(Voxel{{vx, vy, z + k}}, g);
                }
            }
        }
    }

    // Visit the cells of a size, of which there are so many, in shells around the box: those whose gap is at most
    // `limit`, in so many shells. Whether that was all of them.
    template <class Visit>
    static bool in_shells(const Index &size, const Index &count, int64_t shells, const Vec &low, const Vec &high,
                          const double &limit, Visit &&visit) {
        Index first, last, from, to, cell;
        for (int k = 0; k < 3; ++k) {
            const double most = double(count[k] - 1);
            first[k] = int64_t(lesser(larger(std::floor(low[k] / double(size[k])), 0.0), most));
            last[k] = int64_t(lesser(larger(std::floor(high[k] / double(size[k])), 0.0), most));
        }
        for (int64_t r = 0; r < shells; ++r) {
            double least = INF;  // what is r cells away, or farther, is so along one axis
            for (int k = 0; k < 3; ++k) {
                const auto gap_to = [&](int64_t at) { return gap(size[k] * at, size[k], low[k], high[k]); };
                if (first[k] - r >= 0) least = lesser(least, gap_to(first[k] - r));
                if (last[k] + r < count[k]) least = lesser(least, gap_to(last[k] + r));
                from[k] = std::max(first[k] - r, int64_t(0)), to[k] = std::min(last[k] + r, count[k] - 1);
            }
            if (least == INF || least > limit) return true;
            const auto edge = [&](int k) { return cell[k] == first[k] - r || cell[k] == last[k] + r; };
            for (cell[0] = from[0]; cell[0] <= to[0]; ++cell[0]) {
                const double gx = gap(size[0] * cell[0], size[0], low[0], high[0]);
                if (gx > limit) continue;
                for (cell[1] = from[1]; cell[1] <= to[1]; ++cell[1]) {
                    const double gxy = gx + gap(size[1] * cell[1], size[1], low[1], high[1]);
                    if (gxy > limit) continue;
                    const bool all = r == 0 || edge(0) || edge(1);
                    for (cell[2] = from[2]; cell[2] <= to[2]; ++cell[2]) {
                        if (!all && !edge(2)) {  // was in an earlier shell, as all up to the other edge
                            cell[2] = last[2] + r - 1;
                            continue;
                        }
                        if (gxy + gap(size[2] * cell[2], size[2], low[2], high[2]) <= limit) visit(cell);
                    }
                }
            }
        }
        return false;
    }

  public:
    bool nothing = false;  // known to hold none

    explicit Held(const int64_t *shape) : shape(shape) {
        for (int k = 0; k < 3; ++k) {
            tiles[k] = (shape[k] + TILE[k] - 1) / TILE[k];
            regions[k] = (shape[k] + REGION[k] - 1) / REGION[k];
        }
        of_tiles.resize(size_t(tiles[0] * tiles[1] * tiles[2]));
        of_regions.resize(size_t(regions[0] * regions[1] * regions[2]));
    }
    void of(const uint8_t *new_occupied, const uint8_t *new_ground) {
        if (occupied == new_occupied && ground == new_ground) return;
        occupied = new_occupied, ground = new_ground, nothing = false;
        std::fill(of_tiles.begin(), of_tiles.end(), uint8_t(UNKNOWN));
        std::fill(of_regions.begin(), of_regions.end(), uint8_t(UNKNOWN));
    }
    // Visit every voxel whose squared gap to the box is at most `limit`, which a visit may lower; some of them twice.
    template <class Visit> void around(const Vec &low, const Vec &high, const double &limit, Visit &&visit) {
        if (nothing) return;
        const auto look = [&](const Index &tile) {
            if (tile_holds_some(tile)) open(tile, low, high, limit, visit);
        };
        if (in_shells(TILE, tiles, SHELLS, low, high, limit, look)) return;
        in_shells(REGION, regions, std::numeric_limits<int64_t>::max(), low, high, limit, [&](const Index &region) {
            if (region_holds_some(region))
                any_tile(region, [&](const Index &tile) {
                    if (gap(tile, TILE, low, high) <= limit) look(tile);
                    return false;
                });
        });
    }
};

// What a verdict is made of, for one thread; kept from path to path for its memory.
class Judge {
    const Request &asked;
    Held held;
    std::vector<Vec> points;
    std::vector<double> distances;  // of the points [voxels]
    std::vector<Part> parts;
    const uint8_t *occupied, *ground, *blocked;
    double own[2], outer[2];  // radii of both levels of spheres around both ends [voxels]
    bool beside[2];

    int64_t flat(const int64_t *v) const { return (v[0] * asked.shape[1] + v[1]) * asked.shape[2] + v[2]; }
    bool within(const int64_t *v) const {
        return v[0] >= 0 && v[1] >= 0 && v[2] >= 0 && v[0] < asked.shape[0] && v[1] < asked.shape[1] &&
               v[2] < asked.shape[2];
    }
    bool has_ground_beside(const int64_t *v) const {
        const int64_t at = flat(v), steps[3] = {asked.shape[1] * asked.shape[2], asked.shape[2], 1};
        for (int k = 0; k < 3; ++k) {
            if (v[k] > 0 && ground[at - steps[k]]) return true;
            if (v[k] < asked.shape[k] - 1 && ground[at + steps[k]]) return true;
        }
        return false;
    }
    // `beside_ground` of own_distance.py: whether a point in the map touches a free voxel next to the ground.
    bool touches_beside(const Vec &point) const {
        for (int corner = 0; corner < 8; ++corner) {
            int64_t v[3];
            for (int k = 0; k < 3; ++k)
                v[k] = int64_t(std::floor(point[k] + asked.allowed * (corner >> k & 1 ? 1.0 : -1.0)));
            if (within(v) && !occupied[flat(v)] && !ground[flat(v)] && has_ground_beside(v)) return true;
        }
        return false;
    }

    // `cut` of exemptions.py, of one segment.
    void cut(const Vec &a, const Vec &d) {
        const Vec *centres[2] = {&points.front(), &points.back()};
        const double *radii[2] = {own, outer};
        double times[10] = {0.0, 1.0};
        int n = 2;
        for (int level = 0; level < 2; ++level)
            for (int end = 0; end < 2; ++end) {
                const Vec &centre = *centres[end];
                const Vec offset = {{a[0] - centre[0], a[1] - centre[1], a[2] - centre[2]}};
                const double r = radii[level][end], square = dot(d, d), half = dot(d, offset);
                const double rest = dot(offset, offset) - r * r, depth = half * half - square * rest;
                const bool crosses = depth > 0 && square > 0;
                const double far = -half - std::copysign(std::sqrt(crosses ? depth : 0.0), half);
                times[n++] = unit((crosses ? far : 0.0) / (crosses ? square : 1.0));
                times[n++] = unit((crosses ? rest : 0.0) / (crosses ? far : 1.0));
            }
        sort(times);
        for (int k = 0; k + 1 < n; ++k) {
            const double begin = times[k], span = times[k + 1] - times[k];
            if (!(times[k + 1] > begin)) continue;
            Part part = {along(a, begin, d), {{span * d[0], span * d[1], span * d[2]}}, 0, 0};
            const Vec middle = along(part.start, 0.5, part.step);
            for (int level = 0; level < 2; ++level) {
                bool all = true;
                for (int end = 0; end < 2; ++end) {
                    const Vec &centre = *centres[end];
                    const Vec gap = {{middle[0] - centre[0], middle[1] - centre[1], middle[2] - centre[2]}};
                    const bool outside = dot(gap, gap) >= radii[level][end] * radii[level][end];
                    all = all && outside;
                    if (level == 0 && !outside) part.held |= 1 << end;
                }
                part.zone += all;
            }
            parts.push_back(part);
        }
    }

    // `contacts` of contacts.py, of one part: the first forbidden voxel that it touches.
    bool first_hit(const Part &part, int64_t (&hit)[3]) const {
        const Vec &a = part.start, &d = part.step;
        const double grown = asked.tolerance, widest = 1 + grown;
        const bool apart = asked.radius > 0 && !((part.held & 1 && beside[0]) || (part.held & 2 && beside[1]));
        int axis = 0;
        for (int k = 1; k < 3; ++k)
            if (std::fabs(d[k]) > std::fabs(d[axis])) axis = k;
        const int second = axis == 0 ? 1 : 0, third = axis == 2 ? 1 : 2;
        const double begin = a[axis], run = d[axis], speed = run == 0 ? 1.0 : run;
        const double lowest = std::floor(lesser(begin, begin + run) - 2 * grown);
        const double highest = std::floor(larger(begin, begin + run) + 2 * grown);
        const int64_t from = int64_t(larger(lowest, 0.0)), to = int64_t(lesser(highest, double(asked.shape[axis] - 1)));
        double entered = INF;
        bool found = false;
        for (int64_t layer = from; layer <= to; ++layer) {
            const double t_0 = unit((double(layer) - grown - begin) / speed);
            const double t_1 = unit((double(layer + 1) + grown - begin) / speed);
            const Vec u = along(a, t_0, d), w = along(a, t_1, d);
            const int64_t corner_1 = int64_t(std::floor(lesser(u[second], w[second]) - 2 * grown));
            const int64_t corner_2 = int64_t(std::floor(lesser(u[third], w[third]) - 2 * grown));
            for (int nine = 0; nine < 9; ++nine) {
                int64_t v[3];
                v[axis] = layer, v[second] = corner_1 + nine / 3, v[third] = corner_2 + nine % 3;
                if (!within(v)) continue;
                const int64_t at = flat(v);
                if (!occupied[at] && !(blocked && blocked[at]) && !(apart && has_ground_beside(v))) continue;
                double entry = 0.0, leave = 1.0;  // when the part is in the grown cube: `_slab_times`
                for (int k = 0; k < 3; ++k) {
                    const double low = double(v[k]) - grown, high = double(v[k]) + widest;
                    if (d[k] == 0) {
                        if (!(low <= a[k] && a[k] <= high)) entry = INF;
                        continue;
                    }
                    const double s = (low - a[k]) / d[k], t = (high - a[k]) / d[k];
                    entry = larger(entry, lesser(s, t)), leave = lesser(leave, larger(s, t));
                }
                if (!(entry <= leave)) continue;
                // Of those entered at once the lowest layer, x, y and z; layers come in order.
                bool before = !found || entry < entered;
                if (!before && entry == entered && v[axis] == hit[axis])
                    before = v[second] < hit[second] || (v[second] == hit[second] && v[third] < hit[third]);
                if (before) {
                    found = true, entered = entry;
                    for (int k = 0; k < 3; ++k) hit[k] = v[k];
                }
            }
        }
        return found;
    }

    // Distance of every point of the path to the nearest voxel held.
    void measure_points() {
        distances.resize(points.size());
        for (size_t k = 0; k < points.size(); ++k) {
            double limit = INF;
            if (k) {  // no farther than from the point before, and the way from there
                const Vec &p = points[k - 1], &q = points[k];
                const Vec way = {{q[0] - p[0], q[1] - p[1], q[2] - p[2]}};
                const double most = distances[k - 1] + std::sqrt(dot(way, way));
                limit = most * most * (1 + SLACK) + SLACK;
            }
            double best = INF;
            held.around(points[k], points[k], limit, [&](const Voxel &, double gap) {
                if (gap < best) best = limit = gap;
            });
            if (k == 0) held.nothing = best == INF;
            distances[k] = std::sqrt(best);
        }
    }

    // Least squared distances by zone, points that have them, the least of all, and that in each exemption or in both.
    struct Least { double zone[ZONES], all, group[4]; Vec point[ZONES]; };

    // `clearances` of clearance.py, and of the exemptions alone: what is larger than `kept` is any number there.
    void measure_part(const Part &part, const double (&kept)[4], Least &least) {
        const double length = std::sqrt(dot(part.step, part.step));
        const double many = larger(std::ceil(length / PIECE), 1.0);
        const Vec step = {{part.step[0] / many, part.step[1] / many, part.step[2] / many}};
        const double half = 0.5 * length / many;
        double limit;  // what is farther changes nothing: outer zones, which count for inner ones, came first
        const auto lower_limit = [&] {
            limit = least.all;
            if (part.held) limit = larger(limit, lesser(least.group[part.held], kept[part.held] * kept[part.held]));
            limit += SLACK;
        };
        lower_limit();
        for (double k = 0; k < many; ++k) {
            const Vec start = along(part.start, k, step);
            const Vec stop = {{start[0] + step[0], start[1] + step[1], start[2] + step[2]}};
            Vec low, high;
            for (int i = 0; i < 3; ++i) low[i] = lesser(start[i], stop[i]), high[i] = larger(start[i], stop[i]);
            const auto measure = [&](const Voxel &voxel) {
                Vec point;
                const double squared = squared_distance(start, step, voxel, point);
                if (squared < least.zone[part.zone]) least.zone[part.zone] = squared, least.point[part.zone] = point;
                least.all = lesser(least.all, squared);
                least.group[part.held] = lesser(least.group[part.held], squared);
                lower_limit();
            };
            // The voxel nearest to the middle first: where it is beyond the limit and half the piece, so are all.
            const Vec middle = along(start, 0.5, step);
            const double reach = std::sqrt(limit) + half;
            double near = reach * reach * (1 + SLACK) + SLACK;
            bool found = false;
            Voxel nearest;
            held.around(middle, middle, near, [&](const Voxel &voxel, double gap) {
                if (!found || gap < near) found = true, near = gap, nearest = voxel;
            });
            if (!found) continue;
            measure(nearest);
            held.around(low, high, limit, [&](const Voxel &voxel, double) { measure(voxel); });
        }
    }

    void measure(Verdict &verdict) {
        const double first = std::fmin(distances.front(), asked.radius);
        const double last = std::fmin(distances.back(), asked.radius), kept[4] = {0, first, last, lesser(first, last)};
        Least least = {{INF, INF, INF}, INF, {INF, INF, INF, INF}, {}};
        bool cruises = false;
        for (int zone = ZONES - 1; zone >= 0; --zone)
            for (const Part &part : parts)
                if (part.zone == zone) {
                    measure_part(part, kept, least);
                    cruises = cruises || zone == ZONES - 1;
                }
        for (int zone = ZONES - 1; zone > 0; --zone)
            if (least.zone[zone] < least.zone[zone - 1])
                least.zone[zone - 1] = least.zone[zone], least.point[zone - 1] = least.point[zone];
        bool near = asked.radius - std::sqrt(least.zone[1]) > asked.allowed;
        for (int group = 1; group < 4; ++group)
            near = near || kept[group] - std::sqrt(least.group[group]) > asked.allowed;
        verdict.too_near = near;
        report(least, 0, verdict.clearance, verdict.nearest);
        report(least, cruises ? ZONES - 1 : 0, verdict.cruise_clearance, verdict.cruise_nearest);
    }
    void report(const Least &least, int zone, double &clearance, double (&point)[3]) const {
        clearance = asked.spacing * std::sqrt(least.zone[zone]);
        for (int k = 0; k < 3; ++k)
            point[k] = least.zone[zone] < INF ? asked.origin[k] + asked.spacing * (least.point[zone][k] - 0.5) : NOT;
    }

    // `Polylines.of`: the path in index coordinates, and what is known without a map.
    void take_in(const double *path, int64_t count, Verdict &verdict) {
        points.clear();
        bool finite = true, inside = true;
        double length = 0.0;
        for (int64_t t = 0; t < count; ++t) {
            Vec index;
            for (int k = 0; k < 3; ++k) {
                const double local = path[3 * t + k] - asked.origin[k];
                finite = finite && std::isfinite(local);
                index[k] = local / asked.spacing + 0.5;
                inside = inside && index[k] >= -asked.tolerance && index[k] <= double(asked.shape[k]) + asked.tolerance;
            }
            if (t) {
                const Vec &before = points.back();
                const Vec step = {{index[0] - before[0], index[1] - before[1], index[2] - before[2]}};
                length += asked.spacing * std::sqrt(dot(step, step));
            }
            points.push_back(index);
        }
        verdict.finite = finite, verdict.inside = inside, verdict.length = finite ? length : NOT;
    }

    void into_parts() {
        parts.clear();
        bool moves = false;
        for (size_t k = 0; k + 1 < points.size(); ++k) {
            const Vec &p = points[k], &q = points[k + 1];
            const Vec step = {{q[0] - p[0], q[1] - p[1], q[2] - p[2]}};
            if (step[0] == 0 && step[1] == 0 && step[2] == 0) continue;
            moves = true;
            cut(p, step);
        }
        if (!moves) cut(points.front(), {{0, 0, 0}});  // a path that stays where it is
    }

  public:
    explicit Judge(const Request &asked) : asked(asked), held(asked.shape) {}

    void judge(int64_t k) {
        Verdict &verdict = asked.verdicts[k];
        double *at = asked.clearance_at + k * asked.width;
        verdict = {NOT, NOT, NOT, {NOT, NOT, NOT}, {NOT, NOT, NOT}, {-1, -1, -1}, 0, 0, 0, 0};
        for (int64_t t = 0; t < asked.width; ++t) at[t] = NOT;
        take_in(asked.points + 3 * k * asked.width, asked.counts[k], verdict);
        if (!verdict.inside) return;

        const int64_t map = asked.map_of[k];
        occupied = asked.occupied + map * asked.next_occupied, ground = asked.ground + map * asked.next_ground;
        blocked = asked.blocked ? asked.blocked + map * asked.next_blocked : nullptr;
        held.of(occupied, ground);
        for (int end = 0; end < 2; ++end) {
            const double exemption = asked.exemptions[2 * k + end];
            own[end] = exemption > 0 ? exemption / asked.spacing + asked.allowed : 0.0;
            outer[end] = larger(own[end], asked.cruise);
            beside[end] = own[end] > 0 && touches_beside(end ? points.back() : points.front());
        }
        into_parts();
        for (const Part &part : parts)
            if (first_hit(part, verdict.first_hit)) break;
        measure_points();
        for (size_t t = 0; t < points.size(); ++t) at[t] = asked.spacing * distances[t];
        measure(verdict);
        verdict.ok = verdict.first_hit[0] < 0 && !verdict.too_near;
    }
};
}  // namespace

// Fill in all verdicts. 0: done; 1: a count, a map or a shape that cannot be, nothing was done; 2: no memory.
extern "C" int64_t verify_paths(const Request *asked) {
    for (int64_t size : asked->shape)
        if (size < 1) return 1;
    for (int64_t k = 0; k < asked->paths; ++k)
        if (asked->counts[k] < 1 || asked->counts[k] > asked->width || asked->map_of[k] < 0 ||
            asked->map_of[k] >= asked->maps)
            return 1;
    try {
        Judge judge(*asked);
        for (int64_t k = 0; k < asked->paths; ++k) judge.judge(k);
    } catch (const std::exception &) {
        return 2;
    }
    return 0;
}
