/* The gather pass (worker/pass/gather.h): cosine-distributed rays of a tile run's points, all in one direction stratum
 * at a time, and the radiosity that they find. Everything is done 64 lanes at a time in structures of arrays; Embree
 * gets packets of 8. */
#include <math.h>
#include <omp.h>
#include <string.h>
#include <time.h>

#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/lookup.h"
#include "worker/backend/embree/passage.h"
#include "worker/base/memory.h"
#include "worker/pass/gather.h"
#include "worker/sampling/keys.h"
#include "worker/sampling/sequence.h"

enum { LANES = 64, TABLE = 64, SUB_NETS = 4 };

/* A thread's working set. Lane l of step i takes sample i * copies + copy[l] of point `point[l]`. */
struct gather_work {
    struct tile_run_frame frame;
    uint32_t samples, copies, lanes, shared_digits;
    uint32_t point[LANES], copy[LANES];
    uint32_t shift_u[LANES], shift_v[LANES], shift_s[LANES], shift_t[LANES];
    bool partial[LANES];
    uint32_t partial_lanes, partial_lane[LANES];
    /* what the current step's rays are made of */
    float origin[3][LANES], edge_s[3][LANES], edge_t[3][LANES], normal[3][LANES];
    float ray_origin[3][LANES], ray_direction[3][LANES], cosine[LANES];
    /* positions of points whose texel is not one square of one triangle: sample k takes the (k / reuse)-th, which
     * stands at entry k / reuse % TABLE from when it is first wanted; positions_made of them so far */
    uint32_t reuse, positions_made;
    float table_position[3][LANES][TABLE], table_normal[3][LANES][TABLE];
    /* smooth meshes: `normal` is then the axis half-way between geometric and shading normal, and this the geometric
     * one */
    float facet[3][LANES], table_facet[3][LANES][TABLE];
    struct RTCRayHit8 packets[LANES / PACKET];
    /* scenes that leave hits to chance, or tint them: what chance hangs on, of each lane's point and of each ray; and
     * each ray's tint */
    uint32_t chance[LANES], ray_seed[LANES];
    float tint[LANES][3];
    /* sums a point */
    double incident[LANES][3], irradiance[LANES][3], sub_net[SUB_NETS][LANES];
    double escaped[LANES], blocked[LANES], glass[LANES][3];
    /* what the step's rays met, in the order of lanes */
    const struct kiln_tile *hit_tile[LANES];
    const struct kiln_split_tile_run *split_parts[LANES];
    uint64_t hit_point[LANES]; /* surface point or KILN_NO_POINT */
    uint8_t hit_bit[LANES], hit_lane[LANES], split_hit[LANES];
    /* Sobol' points of the pass, and scrambled for the tile: samples values each */
    uint32_t *sobol[4], *scrambled[4];
    uint8_t *sub_net_of; /* of a sample */
};

static void work_destroy(struct gather_work **work)
{
    if (*work == NULL)
        return;
    for (int d = 0; d < 4; d++) {
        kiln_free(&(*work)->sobol[d]);
        kiln_free(&(*work)->scrambled[d]);
    }
    kiln_free(&(*work)->sub_net_of);
    kiln_free(work);
}

/* What no trace changes; once a pass. */
static void start_packets(struct gather_work *w)
{
    for (uint32_t p = 0; p < LANES / PACKET; p++)
        for (int i = 0; i < PACKET; i++) {
            w->packets[p].ray.tnear[i] = 0.0f;
            w->packets[p].ray.time[i] = 0.0f;
            w->packets[p].ray.mask[i] = ~0u;
            w->packets[p].ray.flags[i] = 0;
            w->packets[p].hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        }
}

static int work_create(struct gather_work **work, uint32_t samples, struct kiln_error *error)
{
    int status = kiln_allocate(work, 1, sizeof **work, "the gather pass", error);
    if (status == KILN_OK)
        status = kiln_allocate(&(*work)->sub_net_of, samples, sizeof(uint8_t), "the samples of a pass", error);
    for (uint32_t k = 0; status == KILN_OK && k < samples; k++)
        (*work)->sub_net_of[k] = (uint8_t)((uint64_t)k * SUB_NETS / samples);
    for (int d = 0; d < 4 && status == KILN_OK; d++) {
        status = kiln_allocate(&(*work)->sobol[d], samples, sizeof(uint32_t), "the samples of a pass", error);
        if (status == KILN_OK)
            status = kiln_allocate(&(*work)->scrambled[d], samples, sizeof(uint32_t), "the samples of a tile", error);
        for (uint32_t k = 0; status == KILN_OK && k < samples; k++)
            (*work)->sobol[d][k] = kiln_sobol(k, (uint32_t)d);
    }
    if (status != KILN_OK) {
        work_destroy(work);
        return status;
    }
    (*work)->samples = samples;
    (*work)->shared_digits = kiln_shared_digits(samples);
    (*work)->reuse = kiln_position_reuse(samples);
    start_packets(*work);
    return KILN_OK;
}

KILN_CLONES static void scramble(uint32_t *restrict out, const uint32_t *restrict in, uint32_t count, uint32_t seed)
{
    for (uint32_t k = 0; k < count; k++)
        out[k] = kiln_owen_scramble(in[k], seed);
}

/* Half-way between n and the shading normal there: see kiln_facet_weight. */
static struct kiln_vec3 axis_of(const struct gather_work *w, uint32_t j, struct kiln_vec3 n)
{
    return w->frame.smooth ? vec3_normalize(vec3_add(n, frame_shading(&w->frame, j, n))) : n;
}

/* Positions of the points that are not whole squares. */
static void fill_tables(struct gather_work *w, const struct embree_backend *b, uint32_t wanted)
{
    for (uint32_t k = w->positions_made; k < wanted; k++)
        for (uint32_t j = 0; j < w->frame.count; j++) {
            if (w->frame.whole[j])
                continue;
            const uint32_t i = k % TABLE;
            struct kiln_vec3 p, n;
            frame_position(&w->frame, b, j, kiln_unit_float(w->scrambled[2][k] ^ w->shift_s[j]),
                           kiln_unit_float(w->scrambled[3][k] ^ w->shift_t[j]), &p, &n);
            w->table_position[0][j][i] = p.x, w->table_position[1][j][i] = p.y, w->table_position[2][j][i] = p.z;
            const struct kiln_vec3 axis = axis_of(w, j, n);
            w->table_normal[0][j][i] = axis.x, w->table_normal[1][j][i] = axis.y, w->table_normal[2][j][i] = axis.z;
            w->table_facet[0][j][i] = n.x, w->table_facet[1][j][i] = n.y, w->table_facet[2][j][i] = n.z;
        }
    w->positions_made = wanted > w->positions_made ? wanted : w->positions_made;
}

static void prepare(struct gather_work *w, const struct embree_backend *b, size_t tile_run, uint32_t stream)
{
    frame_build(&w->frame, b, tile_run, 0);
    const uint32_t count = w->frame.count;
    if (count == 0)
        return;
    for (uint32_t d = 0; d < 4; d++)
        scramble(w->scrambled[d], w->sobol[d], w->samples, kiln_gather_seed(w->frame.tile_key, stream, d));
    for (uint32_t j = 0; j < count; j++) { /* the first `count` lanes first: tables need their shifts */
        const uint32_t key = kiln_hash2(w->frame.key[j], stream);
        w->shift_u[j] = kiln_direction_shift(key, KILN_DIMENSION_U, w->shared_digits);
        w->shift_v[j] = kiln_direction_shift(key, KILN_DIMENSION_V, w->shared_digits);
        w->shift_s[j] = kiln_gather_shift(key, KILN_DIMENSION_S);
        w->shift_t[j] = kiln_gather_shift(key, KILN_DIMENSION_T);
    }
    w->positions_made = 0;
    w->copies = LANES / count;
    if (w->copies > w->samples)
        w->copies = w->samples;
    w->lanes = w->copies * count;
    w->partial_lanes = 0;
    for (uint32_t l = 0; l < w->lanes; l++) {
        const uint32_t j = l % count;
        w->point[l] = j;
        w->copy[l] = l / count;
        w->shift_u[l] = w->shift_u[j], w->shift_v[l] = w->shift_v[j];
        w->shift_s[l] = w->shift_s[j], w->shift_t[l] = w->shift_t[j];
        w->chance[l] = kiln_gather_chance(kiln_hash2(w->frame.key[j], stream));
        w->partial[l] = !w->frame.whole[j];
        for (int c = 0; c < 3; c++) {
            w->origin[c][l] = w->frame.origin[c][j];
            w->edge_s[c][l] = w->partial[l] ? 0.0f : w->frame.edge_s[c][j];
            w->edge_t[c][l] = w->partial[l] ? 0.0f : w->frame.edge_t[c][j];
            w->facet[c][l] = w->frame.normal[c][j];
        }
        const struct kiln_vec3 axis = axis_of(w, j, vec3(w->facet[0][l], w->facet[1][l], w->facet[2][l]));
        w->normal[0][l] = axis.x, w->normal[1][l] = axis.y, w->normal[2][l] = axis.z;
        if (w->partial[l])
            w->partial_lane[w->partial_lanes++] = l;
    }
    memset(w->incident, 0, sizeof w->incident);
    memset(w->irradiance, 0, sizeof w->irradiance);
    memset(w->sub_net, 0, sizeof w->sub_net);
    memset(w->glass, 0, sizeof w->glass);
    memset(w->escaped, 0, sizeof w->escaped);
    memset(w->blocked, 0, sizeof w->blocked);
}

/* The scrambled random numbers of one sample, the same for all points. */
struct sample_numbers {
    uint32_t u, v, s, t;
};

/* As kiln_unit_float; through a signed number, which is converted eight at a time. */
static inline float unit_of(uint32_t fraction) { return ((float)(int32_t)(fraction >> 9) + 0.5f) * 0x1p-23f; }

/* Rays of lanes [begin, end), which take the same sample of their points: position in the texel, then a
 * cosine-distributed direction about the normal. */
KILN_CLONES static void make_rays(struct gather_work *restrict w, uint32_t begin, uint32_t end, struct sample_numbers k)
{
    for (uint32_t l = begin; l < end; l++) {
        const float s = unit_of(k.s ^ w->shift_s[l]), t = unit_of(k.t ^ w->shift_t[l]);
        for (int c = 0; c < 3; c++)
            w->ray_origin[c][l] = w->origin[c][l] + s * w->edge_s[c][l] + t * w->edge_t[c][l];
    }
    for (uint32_t l = begin; l < end; l++) {
        const float u = unit_of(k.u ^ w->shift_u[l]), v = unit_of(k.v ^ w->shift_v[l]);
        const float radius = sqrtf(u), z = sqrtf(1.0f - u);
        const float turn = v - 0.5f, a = fabsf(turn);
        const float sine = copysignf(kiln_sine_turn(a < 0.5f - a ? a : 0.5f - a), turn);
        const float x = radius * kiln_sine_turn(0.25f - a), y = radius * sine;
        const float nx = w->normal[0][l], ny = w->normal[1][l], nz = w->normal[2][l];
        const float sign = copysignf(1.0f, nz), f = -1.0f / (sign + nz), g = nx * ny * f; /* kiln_basis */
        w->ray_direction[0][l] = x * (1.0f + sign * nx * nx * f) + y * g + z * nx;
        w->ray_direction[1][l] = x * sign * g + y * (sign + ny * ny * f) + z * ny;
        w->ray_direction[2][l] = -x * sign * nx - y * ny + z * nz;
        w->cosine[l] = z;
    }
}

/* Makes the rays of step `step`, also of points that take their positions from a table. Samples that do not exist have
 * no lanes. Returns how many lanes there are. */
static uint32_t prepare_step(struct gather_work *w, const struct embree_backend *b, uint32_t step)
{
    const uint32_t count = w->frame.count, first = step * w->copies;
    const uint32_t copies = w->samples - first < w->copies ? w->samples - first : w->copies;
    if (w->partial_lanes > 0)
        fill_tables(w, b, (first + copies - 1) / w->reuse + 1);
    for (uint32_t i = 0; i < w->partial_lanes; i++) {
        const uint32_t l = w->partial_lane[i], j = w->point[l], entry = (first + w->copy[l]) / w->reuse % TABLE;
        for (int c = 0; c < 3; c++) {
            w->origin[c][l] = w->table_position[c][j][entry];
            w->normal[c][l] = w->table_normal[c][j][entry];
            w->facet[c][l] = w->table_facet[c][j][entry];
        }
    }
    for (uint32_t c = 0; c < copies; c++) {
        const struct sample_numbers numbers = {w->scrambled[0][first + c], w->scrambled[1][first + c],
                                               w->scrambled[2][first + c], w->scrambled[3][first + c]};
        make_rays(w, c * count, (c + 1) * count, numbers);
    }
    for (uint32_t l = 0; l < copies * count && embree_blends(b); l++)
        w->ray_seed[l] = kiln_gather_ray_seed(w->chance[l], first + w->copy[l]);
    return copies * count;
}

static void fill_packets(struct gather_work *w, uint32_t lanes)
{
    for (uint32_t p = 0, l = 0; l < lanes; p++, l += PACKET) {
        struct RTCRayHit8 *r = &w->packets[p];
        memcpy(r->ray.org_x, &w->ray_origin[0][l], sizeof r->ray.org_x);
        memcpy(r->ray.org_y, &w->ray_origin[1][l], sizeof r->ray.org_y);
        memcpy(r->ray.org_z, &w->ray_origin[2][l], sizeof r->ray.org_z);
        memcpy(r->ray.dir_x, &w->ray_direction[0][l], sizeof r->ray.dir_x);
        memcpy(r->ray.dir_y, &w->ray_direction[1][l], sizeof r->ray.dir_y);
        memcpy(r->ray.dir_z, &w->ray_direction[2][l], sizeof r->ray.dir_z);
        for (int i = 0; i < PACKET; i++) {
            r->ray.tfar[i] = INFINITY;
            r->hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        }
    }
}

static void trace_packets(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                          uint32_t lanes)
{
    static const int all[PACKET] __attribute__((aligned(32))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    const uint32_t whole = lanes / PACKET, rest = lanes % PACKET;
    for (uint32_t p = 0; p < whole; p++)
        embree_nearest8(b, context, all, &w->packets[p], &w->ray_seed[p * PACKET], &w->tint[p * PACKET]);
    if (rest != 0) {
        int valid[PACKET] __attribute__((aligned(32)));
        for (uint32_t i = 0; i < PACKET; i++)
            valid[i] = i < rest ? -1 : 0;
        embree_nearest8(b, context, valid, &w->packets[whole], &w->ray_seed[whole * PACKET], &w->tint[whole * PACKET]);
    }
}

/* Bit of a texel in its tile: kiln_morton8 of the low three bits of x and y, by y * 8 + x. */
static const uint8_t morton_of[KILN_TILE_TEXELS] = {
    0,  1,  4,  5,  16, 17, 20, 21, 2,  3,  6,  7,  18, 19, 22, 23, 8,  9,  12, 13, 24, 25,
    28, 29, 10, 11, 14, 15, 26, 27, 30, 31, 32, 33, 36, 37, 48, 49, 52, 53, 34, 35, 38, 39,
    50, 51, 54, 55, 40, 41, 44, 45, 56, 57, 60, 61, 42, 43, 46, 47, 58, 59, 62, 63,
};

/* kiln_facet_weight of a lane's direction. */
static inline float facet_weight(const struct gather_work *w, uint32_t l)
{
    if (!w->frame.smooth)
        return 1.0f;
    const float cosine = w->facet[0][l] * w->ray_direction[0][l] + w->facet[1][l] * w->ray_direction[1][l] +
                         w->facet[2][l] * w->ray_direction[2][l];
    const float tilt =
        w->facet[0][l] * w->normal[0][l] + w->facet[1][l] * w->normal[1][l] + w->facet[2][l] * w->normal[2][l];
    return kiln_facet_weight(cosine, tilt, w->cosine[l]);
}

/* From hits to surface points in three rounds, so that each load has been asked for a round before: the way to memory
 * is as long as tracing a ray. First the tile of each hit; what missed or met a back face is counted and drops out. */
KILN_CLONES static uint32_t find_tiles(const struct embree_backend *b, struct gather_work *w, uint32_t lanes)
{
    const struct kiln_hit_record *records = b->params.geometry->records;
    const struct kiln_lightmap *lightmaps = b->surface->lightmaps;
    const struct kiln_tile *tiles = b->surface->tiles;
    uint32_t count = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const struct RTCRayHit8 *r = &w->packets[l / PACKET];
        const uint32_t i = l % PACKET, j = w->point[l];
        const unsigned geometry = r->hit.geomID[i];
        if (geometry == RTC_INVALID_GEOMETRY_ID) {
            w->escaped[j] += (double)facet_weight(w, l);
            continue;
        }
        const struct kiln_hit_record *record = &records[embree_triangle(b, geometry, r->hit.primID[i])];
        const float facing = r->hit.Ng_x[i] * w->ray_direction[0][l] + r->hit.Ng_y[i] * w->ray_direction[1][l] +
                             r->hit.Ng_z[i] * w->ray_direction[2][l];
        if (facing > 0.0f && (record->material & KILN_RECORD_DOUBLE_SIDED) == 0) {
            w->blocked[j] += (double)facet_weight(w, l);
            continue;
        }
        const struct kiln_lightmap *map = &lightmaps[record->object];
        const float u = r->hit.u[i], v = r->hit.v[i];
        int32_t x = kiln_hit_column(record, u, v, map->width), y = kiln_hit_row(record, u, v, map->height);
        if (facing > 0.0f) {
            map = &lightmaps[b->surface->object_count + record->object];
            x >>= map->shift;
            y >>= map->shift;
        }
        const struct kiln_tile *tile = &tiles[map->tile_first + kiln_tile_of((uint32_t)x, (uint32_t)y, map->tiles_x)];
        __builtin_prefetch(tile);
        w->hit_tile[count] = tile;
        w->hit_bit[count] = morton_of[((uint32_t)y & 7u) << 3 | ((uint32_t)x & 7u)];
        w->hit_lane[count++] = (uint8_t)l;
    }
    return count;
}

/* Then the point in its tile; a tile that lies in several cells has parts, which are looked at in the end. */
KILN_CLONES static void find_points(const struct embree_backend *b, struct gather_work *w, uint32_t count)
{
    uint32_t split_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_tile *tile = w->hit_tile[i];
        const uint64_t mask = tile->mask, first = tile->first, bit = 1ull << w->hit_bit[i];
        if ((first & KILN_TILE_SPLIT) != 0) {
            const struct kiln_split_tile_run *parts = b->surface->splits + (first & ~KILN_TILE_SPLIT);
            __builtin_prefetch(parts);
            w->split_parts[split_count] = parts;
            w->split_hit[split_count++] = (uint8_t)i;
        }
        w->hit_point[i] = (mask & bit) != 0 ? first + (uint64_t)__builtin_popcountll(mask & (bit - 1)) : KILN_NO_POINT;
        if ((first & KILN_TILE_SPLIT) == 0 && w->hit_point[i] != KILN_NO_POINT)
            __builtin_prefetch(&b->radiosity[w->hit_point[i]]);
    }
    for (uint32_t k = 0; k < split_count; k++) {
        const uint32_t i = w->split_hit[k];
        if (w->hit_point[i] == KILN_NO_POINT)
            continue;
        const uint64_t bit = 1ull << w->hit_bit[i];
        const struct kiln_split_tile_run *part = w->split_parts[k];
        while ((part->mask & bit) == 0)
            part++;
        w->hit_point[i] = part->first.at + (uint64_t)__builtin_popcountll(part->mask & (bit - 1));
        __builtin_prefetch(&b->radiosity[w->hit_point[i]]);
    }
}

/* At last the radiosity is added, lane by lane: for each point in the order of its samples, whatever the number of
 * lanes. */
KILN_CLONES static void collect(const struct embree_backend *b, struct gather_work *w, uint32_t step, uint32_t count)
{
    const uint32_t first = step * w->copies;
    const bool tints = embree_tints(b);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t l = w->hit_lane[i], j = w->point[l];
        const float facet = facet_weight(w, l);
        float rgb[3] = {0.0f, 0.0f, 0.0f}, weight = facet;
        if (w->hit_point[i] != KILN_NO_POINT && facet > 0.0f)
            kiln_radiosity_unpack(b->radiosity[w->hit_point[i]], rgb);
        for (int c = 0; c < 3 && tints; c++) {
            rgb[c] *= w->tint[l][c];
            w->glass[j][c] += (double)(facet * (1.0f - w->tint[l][c]));
        }
        if (w->frame.smooth) {
            const struct kiln_vec3 shading =
                frame_shading(&w->frame, j, vec3(w->facet[0][l], w->facet[1][l], w->facet[2][l]));
            const float cosine = shading.x * w->ray_direction[0][l] + shading.y * w->ray_direction[1][l] +
                                 shading.z * w->ray_direction[2][l];
            weight = kiln_shading_weight(cosine, w->cosine[l]);
            for (int c = 0; c < 3; c++)
                w->irradiance[j][c] += (double)(weight * rgb[c]);
        }
        for (int c = 0; c < 3; c++)
            w->incident[j][c] += (double)(facet * rgb[c]);
        w->sub_net[w->sub_net_of[first + w->copy[l]]][j] += (double)(weight * kiln_luminance_in_float(rgb));
    }
}

/* Standard error of the mean of four sub-nets: more than the error of the whole net, whose parts balance one another.
 */
static float sub_net_error(const struct gather_work *w, uint32_t j)
{
    if (w->samples < SUB_NETS)
        return 0.0f;
    double mean = 0.0, square = 0.0, value[SUB_NETS];
    for (int i = 0; i < SUB_NETS; i++) {
        value[i] = w->sub_net[i][j] * SUB_NETS / w->samples;
        mean += value[i] / SUB_NETS;
    }
    for (int i = 0; i < SUB_NETS; i++)
        square += (value[i] - mean) * (value[i] - mean);
    return (float)sqrt(square / (SUB_NETS * (SUB_NETS - 1)));
}

static void store(const struct gather_work *w, struct kiln_point_result *results)
{
    const double scale = 1.0 / (double)w->samples;
    for (uint32_t j = 0; j < w->frame.count; j++) {
        struct kiln_point_result *r = &results[w->frame.place[j]];
        for (int c = 0; c < 3; c++) {
            r->incident[c] = (float)(w->incident[j][c] * scale);
            r->irradiance[c] = w->frame.smooth ? (float)(w->irradiance[j][c] * scale) : r->incident[c];
            r->glass[c] = (float)(w->glass[j][c] * scale);
        }
        r->error = sub_net_error(w, j);
        r->present = w->frame.present[j];
        r->escaped = (float)(w->escaped[j] * scale);
        r->blocked = (float)(w->blocked[j] * scale);
    }
}

static uint32_t steps_of(const struct gather_work *w) { return (w->samples + w->copies - 1) / w->copies; }

static void gather_tile_run(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                            size_t tile_run, uint32_t stream, struct kiln_point_result *results, uint64_t *rays)
{
    memset(results, 0, b->surface->tile_runs[tile_run].count * sizeof *results);
    prepare(w, b, tile_run, stream);
    if (w->frame.count == 0)
        return;
    const uint32_t steps = steps_of(w);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = prepare_step(w, b, step);
        fill_packets(w, lanes);
        trace_packets(b, context, w, lanes);
        const uint32_t hits = find_tiles(b, w, lanes);
        find_points(b, w, hits);
        collect(b, w, step, hits);
        *rays += lanes;
    }
    store(w, results);
}

int embree_gather(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    (void)parameters;
    struct kiln_point_result *const part_results = results;
    const uint64_t base = b->surface->tile_runs[part->first].first.at;
    uint64_t traced = 0;
    double seconds = 0.0;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced, seconds)
    {
        struct gather_work *w = NULL;
        struct kiln_error own;
        const int created = work_create(&w, part->samples, &own);
        if (created != KILN_OK) {
#pragma omp critical(kiln_gather_status)
            status = kiln_fail(error, created, "%s", own.message);
        }
#pragma omp barrier
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
        const double begin = embree_thread_seconds();
#pragma omp for schedule(dynamic, 4) nowait
        for (size_t i = 0; i < part->count; i++) {
            const size_t tile_run = part->first + i;
            if (status == KILN_OK)
                gather_tile_run(b, &context, w, tile_run, part->stream,
                                part_results + (b->surface->tile_runs[tile_run].first.at - base), &traced);
        }
        seconds += embree_thread_seconds() - begin;
        embree_leave(saved);
        work_destroy(&w);
    }
    *rays += traced;
    b->thread_seconds += seconds;
    return status;
}

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int embree_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error)
{
    struct embree_backend *b = (struct embree_backend *)backend;
    struct gather_work *w = NULL;
    const int status = work_create(&w, batch->samples, error);
    if (status != KILN_OK)
        return status;
    const unsigned saved = embree_enter();
    struct embree_context context;
    embree_context(b, &context);
    for (size_t i = 0; i < batch->count; i++) {
        prepare(w, b, batch->first + i, batch->stream);
        const uint32_t steps = w->frame.count == 0 ? 0 : steps_of(w);
        for (uint32_t step = 0; step < steps; step++) {
            const uint32_t lanes = prepare_step(w, b, step);
            fill_packets(w, lanes);
            const double start = seconds_now();
            trace_packets(b, &context, w, lanes);
            *seconds += seconds_now() - start;
            *rays += lanes;
        }
    }
    embree_leave(saved);
    work_destroy(&w);
    return KILN_OK;
}
