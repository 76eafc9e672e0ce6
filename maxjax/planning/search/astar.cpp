// The search of astar.py, compiled: the same labels in the same order, hence the same path, voxel by voxel.
//
// Lengths count eighths of a voxel and are multiples of 2^-33, so that their sums are exact. A label counts only for the
// query that wrote it, so that a query touches no more memory than it explores.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <limits>
#include <vector>

struct Query {
    const uint8_t *blocked;  // not 0: a path must not go there
    const float *price;      // n >= 1 of every voxel; null: 1 everywhere
    int64_t start, goal;     // flat indices of free voxels
    uint8_t *path;           // out: steps from start to goal, the first of them where not all fit
    int64_t room;            // how many fit
    int64_t count;           // out: steps of the path; -1: there is none, -2: memory did not suffice
    int64_t expanded;        // out
};

namespace {
constexpr int STEPS = 26, AT_START = STEPS;
struct Label { double g; uint32_t query; uint8_t came; };  // `came`: the step by which the voxel was reached
struct Open { double g; int64_t at; };
struct Step { int64_t x, y, z, offset; double length; };
struct Memo { uint32_t key, steps; };
double rounded(int axes) { return std::round(8 * std::sqrt(double(axes)) * 0x1p33) * 0x1p-33; }
const double ONE = rounded(1), TWO = rounded(2), THREE = rounded(3);
}  // namespace

struct Search {  // what one thread needs for maps of one shape
    const int64_t nx, ny, nz;
    const uint32_t *const rules;  // of each arrival, from `first`: step, voxels that it spans, how many detours, these
    const int64_t *const first;
    Label *const labels;
    Step steps[STEPS];
    std::vector<Memo> memo = std::vector<Memo>(1 << 12, Memo{~0u, 0});
    std::vector<std::vector<Open>> stacks;  // open voxels by the whole part of f, the last one in leaves first
    size_t used = 0;
    uint32_t query = 0;
    int64_t gx, gy, gz;

    Search(const int64_t *shape, const uint32_t *rules, const int64_t *first)
        : nx(shape[0]), ny(shape[1]), nz(shape[2]), rules(rules), first(first),
          labels(static_cast<Label *>(std::calloc(nx * ny * nz, sizeof(Label)))) {  // no memory until it is written
        for (int k = 0; k < STEPS; ++k) {
            const int64_t at = k < STEPS / 2 ? k : k + 1, x = at / 9 - 1, y = at / 3 % 3 - 1, z = at % 3 - 1;
            steps[k] = {x, y, z, (x * ny + y) * nz + z, rounded(x * x + y * y + z * z)};
        }
    }
    Search(const Search &) = delete;
    ~Search() { std::free(labels); }

    double octile(int64_t x, int64_t y, int64_t z) const {
        const int64_t a = std::abs(x - gx), b = std::abs(y - gy), c = std::abs(z - gz);
        const int64_t most = std::max({a, b, c}), least = std::min({a, b, c}), middle = a + b + c - most - least;
        return ONE * (most - middle) + TWO * (middle - least) + THREE * least;
    }

    uint32_t window(const uint8_t *blocked, int64_t x, int64_t y, int64_t z) const {
        uint32_t code = 0;
        for (int at = 0; at < 27; ++at) {
            const int64_t u = x + at / 9 - 1, v = y + at / 3 % 3 - 1, w = z + at % 3 - 1;
            const bool inside = uint64_t(u) < uint64_t(nx) && uint64_t(v) < uint64_t(ny) && uint64_t(w) < uint64_t(nz);
            code |= uint32_t(!inside || blocked[(u * ny + v) * nz + w]) << at;
        }
        return code;
    }

    uint32_t successors(uint32_t code, uint32_t arrival) const {  // a bit for each step
        uint32_t found = 0;
        for (const uint32_t *r = rules + first[arrival]; r < rules + first[arrival + 1]; r += 3 + r[2])
            if (!(code & r[1]) && std::all_of(r + 3, r + 3 + r[2], [=](uint32_t detour) { return code & detour; }))
                found |= 1u << r[0];
        return found;
    }

    uint32_t tried(const Query &q, int64_t x, int64_t y, int64_t z, uint32_t came) {
        const uint32_t arrival = q.price ? AT_START : came, key = window(q.blocked, x, y, z) << 5 | arrival;
        Memo &known = memo[(key * 2654435769u) >> 20];
        if (known.key != key) known = {key, successors(key >> 5, arrival)};
        return q.price && came != AT_START ? known.steps & ~(1u << (STEPS - 1 - came)) : known.steps;
    }

    void push(double f, size_t least, Open open) {
        const size_t k = std::max(size_t(f), least);  // rounding must not put it below the stack in work
        if (k >= stacks.size()) stacks.resize(k + 1);
        used = std::max(used, k + 1);
        stacks[k].push_back(open);
    }

    void run(Query &q) {
        for (size_t k = 0; k < used; ++k) stacks[k].clear();
        used = 0;
        if (++query == 0) std::fill(labels, labels + nx * ny * nz, Label{}), query = 1;
        gx = q.goal / (ny * nz), gy = q.goal / nz % ny, gz = q.goal % nz;
        q.expanded = 0, q.count = -1;
        const double g_start = -octile(q.start / (ny * nz), q.start / nz % ny, q.start % nz);  // f starts at 0
        labels[q.start] = {g_start, query, AT_START};
        double best = q.start == q.goal ? g_start : std::numeric_limits<double>::infinity();
        push(0, 0, {g_start, q.start});
        for (size_t lower = 0; lower < used && double(lower) < best; ++lower) {
            while (!stacks[lower].empty()) {
                const auto [g_i, i] = stacks[lower].back();
                stacks[lower].pop_back();
                const int64_t x = i / (ny * nz), y = i / nz % ny, z = i % nz;
                if (g_i != labels[i].g || g_i + octile(x, y, z) >= best) continue;  // superseded, or of no use any more
                ++q.expanded;
                for (uint32_t left = tried(q, x, y, z, labels[i].came); left; left &= left - 1) {
                    const int k = __builtin_ctz(left);
                    const Step &step = steps[k];
                    const int64_t j = i + step.offset;
                    const double n = q.price ? 0.5 * double(q.price[i]) + 0.5 * double(q.price[j]) : 1;
                    const double g_j = g_i + step.length * n;
                    if (labels[j].query == query && g_j >= labels[j].g) continue;
                    const double f = g_j + octile(x + step.x, y + step.y, z + step.z);
                    if (f >= best) continue;
                    labels[j] = {g_j, query, uint8_t(k)};
                    if (j == q.goal) best = f;
                    else push(f, lower, {g_j, j});
                }
            }
        }
        if (best < std::numeric_limits<double>::infinity()) trace(q);
    }

    void trace(Query &q) const {
        q.count = 0;
        for (int64_t i = q.goal; i != q.start; i -= steps[labels[i].came].offset) ++q.count;
        int64_t k = q.count;
        for (int64_t i = q.goal; i != q.start; i -= steps[labels[i].came].offset)
            if (--k < q.room) q.path[k] = labels[i].came;
    }
};

extern "C" {

Search *search_new(const int64_t *shape, const uint32_t *rules, const int64_t *first) try {  // null: no memory
    auto *search = new Search(shape, rules, first);
    if (search->labels) return search;
    delete search;
    return nullptr;
} catch (const std::exception &) {
    return nullptr;
}

void search_delete(Search *search) { delete search; }

void search_run(Search *search, Query *queries, int64_t count) {
    for (Query *q = queries; q < queries + count; ++q) try {
            search->run(*q);
        } catch (const std::exception &) {
            q->count = -2;
        }
}
}
