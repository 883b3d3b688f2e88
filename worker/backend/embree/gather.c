/* The bounce pass: cosine-distributed rays of a fragment's points, all in one direction stratum at a time, and the radiosity
 * that they find. Everything is done 64 lanes at a time in structures of arrays; Embree gets packets of 8. */
#include <math.h>
#include <omp.h>
#include <string.h>
#include <time.h>

#include "shaders/random.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/lookup.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

enum { LANES = 64, TABLE = 32, SUB_NETS = 4 };

/* A thread's working set. Lane l of step i takes sample i * copies + copy[l] of point `point[l]`. */
struct gather_work {
    struct fragment_frame frame;
    uint32_t samples, copies, lanes, shared_digits;
    uint32_t point[LANES], copy[LANES];
    uint32_t shift_u[LANES], shift_v[LANES], shift_s[LANES], shift_t[LANES];
    bool partial[LANES];
    uint32_t partial_lanes, partial_lane[LANES];
    /* what the current step's rays are made of */
    float origin[3][LANES], edge_s[3][LANES], edge_t[3][LANES], normal[3][LANES];
    uint32_t u[LANES], v[LANES], s[LANES], t[LANES];
    float ray_origin[3][LANES], ray_direction[3][LANES], cosine[LANES];
    /* positions of points whose texel is not one square of one triangle: TABLE (or `samples`) of them, used in turn */
    float table_position[3][LANES][TABLE], table_normal[3][LANES][TABLE];
    struct RTCRayHit8 packets[LANES / PACKET];
    /* sums a point */
    double incident[LANES][3], irradiance[LANES][3], sub_net[SUB_NETS][LANES];
    uint32_t escaped[LANES], blocked[LANES];
    /* Sobol' points of the pass, and scrambled for the tile: samples values each */
    uint32_t *sobol[4], *scrambled[4];
};

static void work_destroy(struct gather_work **work)
{
    if (*work == NULL)
        return;
    for (int d = 0; d < 4; d++) {
        kiln_free(&(*work)->sobol[d]);
        kiln_free(&(*work)->scrambled[d]);
    }
    kiln_free(work);
}

static int work_create(struct gather_work **work, uint32_t samples, struct kiln_error *error)
{
    int status = kiln_allocate(work, 1, sizeof **work, "the gather pass", error);
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
    return KILN_OK;
}

KILN_CLONES static void scramble(uint32_t *restrict out, const uint32_t *restrict in, uint32_t count, uint32_t seed)
{
    for (uint32_t k = 0; k < count; k++)
        out[k] = kiln_owen_scramble(in[k], seed);
}

/* Positions of the points that are not whole squares. */
static void fill_tables(struct gather_work *w, const struct embree_backend *b)
{
    const uint32_t size = w->samples < TABLE ? w->samples : TABLE;
    for (uint32_t j = 0; j < w->frame.count; j++) {
        if (w->frame.whole[j])
            continue;
        for (uint32_t i = 0; i < size; i++) {
            struct kiln_vec3 p, n;
            frame_position(&w->frame, b, j, kiln_unit_float(w->scrambled[2][i] ^ w->shift_s[j]),
                           kiln_unit_float(w->scrambled[3][i] ^ w->shift_t[j]), &p, &n);
            w->table_position[0][j][i] = p.x, w->table_position[1][j][i] = p.y, w->table_position[2][j][i] = p.z;
            w->table_normal[0][j][i] = n.x, w->table_normal[1][j][i] = n.y, w->table_normal[2][j][i] = n.z;
        }
    }
}

static void prepare(struct gather_work *w, const struct embree_backend *b, size_t fragment, uint32_t stream)
{
    frame_build(&w->frame, b, fragment, false);
    const uint32_t count = w->frame.count;
    if (count == 0)
        return;
    for (uint32_t d = 0; d < 4; d++)
        scramble(w->scrambled[d], w->sobol[d], w->samples, kiln_hash2(w->frame.tile_key, stream * 8 + d));
    for (uint32_t j = 0; j < count; j++) { /* the first `count` lanes first: tables need their shifts */
        const uint32_t key = kiln_hash2(w->frame.key[j], stream);
        w->shift_u[j] = kiln_hash1(key + 1u) >> w->shared_digits;
        w->shift_v[j] = kiln_hash1(key + 2u) >> w->shared_digits;
        w->shift_s[j] = kiln_hash1(key + 3u);
        w->shift_t[j] = kiln_hash1(key + 4u);
    }
    fill_tables(w, b);
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
        w->partial[l] = !w->frame.whole[j];
        for (int c = 0; c < 3; c++) {
            w->origin[c][l] = w->frame.origin[c][j];
            w->edge_s[c][l] = w->partial[l] ? 0.0f : w->frame.edge_s[c][j];
            w->edge_t[c][l] = w->partial[l] ? 0.0f : w->frame.edge_t[c][j];
            w->normal[c][l] = w->frame.normal[c][j];
        }
        if (w->partial[l])
            w->partial_lane[w->partial_lanes++] = l;
    }
    memset(w->incident, 0, sizeof w->incident);
    memset(w->irradiance, 0, sizeof w->irradiance);
    memset(w->sub_net, 0, sizeof w->sub_net);
    memset(w->escaped, 0, sizeof w->escaped);
    memset(w->blocked, 0, sizeof w->blocked);
}

/* sin(2 pi x) for |x| <= 1/4: odd polynomial, error below 3e-7. */
static inline float sine_turn(float x)
{
    const float y = x * x;
    return x * (6.28318525f + y * (-41.3416996f + y * (81.6018372f + y * (-76.5498123f + y * 39.5374527f))));
}

/* Turns the step's random numbers into rays: position in the texel, then a cosine-distributed direction about the normal. */
KILN_CLONES static void make_rays(struct gather_work *restrict w)
{
    for (uint32_t l = 0; l < LANES; l++) {
        const float s = ((float)(int32_t)(w->s[l] >> 8) + 0.5f) * 0x1p-24f, t = ((float)(int32_t)(w->t[l] >> 8) + 0.5f) * 0x1p-24f;
        for (int c = 0; c < 3; c++)
            w->ray_origin[c][l] = w->origin[c][l] + s * w->edge_s[c][l] + t * w->edge_t[c][l];
    }
    for (uint32_t l = 0; l < LANES; l++) {
        const float u = ((float)(int32_t)(w->u[l] >> 8) + 0.5f) * 0x1p-24f, v = ((float)(int32_t)(w->v[l] >> 8) + 0.5f) * 0x1p-24f;
        const float radius = sqrtf(u), z = sqrtf(1.0f - u);
        const float turn = v - 0.5f, a = fabsf(turn);
        const float sine = copysignf(sine_turn(a < 0.5f - a ? a : 0.5f - a), turn);
        const float x = radius * sine_turn(0.25f - a), y = radius * sine;
        const float nx = w->normal[0][l], ny = w->normal[1][l], nz = w->normal[2][l];
        const float sign = copysignf(1.0f, nz), f = -1.0f / (sign + nz), g = nx * ny * f; /* kiln_basis */
        w->ray_direction[0][l] = x * (1.0f + sign * nx * nx * f) + y * g + z * nx;
        w->ray_direction[1][l] = x * sign * g + y * (sign + ny * ny * f) + z * ny;
        w->ray_direction[2][l] = -x * sign * nx - y * ny + z * nz;
        w->cosine[l] = z;
    }
}

/* Random numbers of step `step`; lanes whose sample does not exist are not traced. Returns how many lanes are. */
static uint32_t draw(struct gather_work *w, uint32_t step)
{
    const uint32_t count = w->frame.count, first = step * w->copies;
    const uint32_t copies = w->samples - first < w->copies ? w->samples - first : w->copies;
    for (uint32_t c = 0, l = 0; c < copies; c++) {
        const uint32_t u = w->scrambled[0][first + c], v = w->scrambled[1][first + c];
        const uint32_t s = w->scrambled[2][first + c], t = w->scrambled[3][first + c];
        for (uint32_t j = 0; j < count; j++, l++) {
            w->u[l] = u ^ w->shift_u[l];
            w->v[l] = v ^ w->shift_v[l];
            w->s[l] = s ^ w->shift_s[l];
            w->t[l] = t ^ w->shift_t[l];
        }
    }
    const uint32_t size = w->samples < TABLE ? w->samples : TABLE;
    for (uint32_t i = 0; i < w->partial_lanes; i++) {
        const uint32_t l = w->partial_lane[i], j = w->point[l], entry = (first + w->copy[l]) % size;
        for (int c = 0; c < 3; c++) {
            w->origin[c][l] = w->table_position[c][j][entry];
            w->normal[c][l] = w->table_normal[c][j][entry];
        }
    }
    return copies * count;
}

static uint32_t fill_packets(struct gather_work *w, uint32_t lanes)
{
    const uint32_t packets = (lanes + PACKET - 1) / PACKET;
    for (uint32_t p = 0; p < packets; p++) {
        struct RTCRayHit8 *r = &w->packets[p];
        const uint32_t l = p * PACKET;
        memcpy(r->ray.org_x, &w->ray_origin[0][l], sizeof r->ray.org_x);
        memcpy(r->ray.org_y, &w->ray_origin[1][l], sizeof r->ray.org_y);
        memcpy(r->ray.org_z, &w->ray_origin[2][l], sizeof r->ray.org_z);
        memcpy(r->ray.dir_x, &w->ray_direction[0][l], sizeof r->ray.dir_x);
        memcpy(r->ray.dir_y, &w->ray_direction[1][l], sizeof r->ray.dir_y);
        memcpy(r->ray.dir_z, &w->ray_direction[2][l], sizeof r->ray.dir_z);
        for (int i = 0; i < PACKET; i++) {
            r->ray.tnear[i] = 0.0f;
            r->ray.tfar[i] = INFINITY;
            r->ray.time[i] = 0.0f;
            r->ray.mask[i] = ~0u;
            r->ray.flags[i] = 0;
            r->hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
            r->hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        }
    }
    return packets;
}

static void trace_packets(const struct embree_backend *b, struct RTCIntersectContext *context, struct gather_work *w, uint32_t lanes)
{
    static const int all[PACKET] __attribute__((aligned(32))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    const uint32_t whole = lanes / PACKET, rest = lanes % PACKET;
    for (uint32_t p = 0; p < whole; p++)
        rtcIntersect8(all, b->scene, context, &w->packets[p]);
    if (rest != 0) {
        int valid[PACKET] __attribute__((aligned(32)));
        for (uint32_t i = 0; i < PACKET; i++)
            valid[i] = i < rest ? -1 : 0;
        rtcIntersect8(valid, b->scene, context, &w->packets[whole]);
    }
}

/* Adds the step's answers, lane by lane: for each point in the order of its samples, whatever the number of lanes. */
KILN_CLONES static void collect(const struct embree_backend *b, struct gather_work *w, uint32_t step, uint32_t lanes)
{
    const uint32_t first = step * w->copies;
    for (uint32_t l = 0; l < lanes; l++) {
        const struct RTCRayHit8 *r = &w->packets[l / PACKET];
        const uint32_t i = l % PACKET, j = w->point[l];
        const unsigned geometry = r->hit.geomID[i];
        if (geometry == RTC_INVALID_GEOMETRY_ID) {
            w->escaped[j]++;
            continue;
        }
        const uint32_t triangle = embree_triangle(b, geometry, r->hit.primID[i]);
        const float facing = r->hit.Ng_x[i] * w->ray_direction[0][l] + r->hit.Ng_y[i] * w->ray_direction[1][l] + r->hit.Ng_z[i] * w->ray_direction[2][l];
        if (facing > 0.0f && (b->params.geometry->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0) {
            w->blocked[j]++;
            continue;
        }
        float rgb[3];
        kiln_radiosity_unpack(embree_radiosity(b, triangle, r->hit.u[i], r->hit.v[i]), rgb);
        float weight = 1.0f;
        if (w->frame.smooth) {
            const float cosine = w->frame.shading[0][j] * w->ray_direction[0][l] + w->frame.shading[1][j] * w->ray_direction[1][l] +
                                 w->frame.shading[2][j] * w->ray_direction[2][l];
            weight = cosine > 0.0f ? cosine / w->cosine[l] : 0.0f;
            for (int c = 0; c < 3; c++)
                w->irradiance[j][c] += (double)(weight * rgb[c]);
        }
        for (int c = 0; c < 3; c++)
            w->incident[j][c] += (double)rgb[c];
        const uint32_t sample = first + w->copy[l];
        const uint32_t sub_net = (uint32_t)((uint64_t)sample * SUB_NETS / w->samples);
        w->sub_net[sub_net][j] += (double)(weight * (0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2]));
    }
}

/* Standard error of the mean of four sub-nets: more than the error of the whole net, whose parts balance one another. */
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
        }
        r->error = sub_net_error(w, j);
        r->escaped = (float)((double)w->escaped[j] * scale);
        r->blocked = (float)((double)w->blocked[j] * scale);
    }
}

static uint32_t steps_of(const struct gather_work *w) { return (w->samples + w->copies - 1) / w->copies; }

static void gather_fragment(const struct embree_backend *b, struct RTCIntersectContext *context, struct gather_work *w, size_t fragment,
                            uint32_t stream, struct kiln_point_result *results, uint64_t *rays)
{
    memset(results, 0, b->surface->fragments[fragment].count * sizeof *results);
    prepare(w, b, fragment, stream);
    if (w->frame.count == 0)
        return;
    const uint32_t steps = steps_of(w);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = draw(w, step);
        make_rays(w);
        (void)fill_packets(w, lanes);
        trace_packets(b, context, w, lanes);
        collect(b, w, step, lanes);
        *rays += lanes;
    }
    store(w, results);
}

int embree_gather(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream, uint64_t *rays,
                  struct kiln_error *error)
{
    struct embree_backend *b = (struct embree_backend *)backend;
    const uint64_t base = b->surface->fragments[batch->fragment_first].first;
    uint64_t traced = 0;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced)
    {
        struct gather_work *w = NULL;
        struct kiln_error own;
        const int created = work_create(&w, samples, &own);
        if (created != KILN_OK) {
#pragma omp critical(kiln_gather_status)
            status = kiln_fail(error, created, "%s", own.message);
        }
#pragma omp barrier
        const unsigned saved = embree_enter();
        struct RTCIntersectContext context;
        embree_context(b, &context);
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < batch->fragment_count; i++) {
            const size_t fragment = batch->fragment_first + i;
            if (status == KILN_OK)
                gather_fragment(b, &context, w, fragment, stream, batch->results + (b->surface->fragments[fragment].first - base), &traced);
        }
        embree_leave(saved);
        work_destroy(&w);
    }
    *rays += traced;
    return status;
}

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int embree_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream, double *seconds,
                   uint64_t *rays, struct kiln_error *error)
{
    struct embree_backend *b = (struct embree_backend *)backend;
    struct gather_work *w = NULL;
    const int status = work_create(&w, samples, error);
    if (status != KILN_OK)
        return status;
    const unsigned saved = embree_enter();
    struct RTCIntersectContext context;
    embree_context(b, &context);
    for (size_t i = 0; i < batch->fragment_count; i++) {
        prepare(w, b, batch->fragment_first + i, stream);
        const uint32_t steps = w->frame.count == 0 ? 0 : steps_of(w);
        for (uint32_t step = 0; step < steps; step++) {
            const uint32_t lanes = draw(w, step);
            make_rays(w);
            (void)fill_packets(w, lanes);
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
