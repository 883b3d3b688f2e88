#include "worker/backend/embree/rays.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/guide.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/sampling/sequence.h"

void rays_destroy(struct tile_run_rays **rays)
{
    if (*rays == NULL)
        return;
    for (int d = 0; d < 4; d++) {
        kiln_free(&(*rays)->sobol[d]);
        kiln_free(&(*rays)->scrambled[d]);
    }
    kiln_free(&(*rays)->quarter_of);
    kiln_free(rays);
}

/* Sets the members that tracing never changes, once per pass. */
static void start_packets(struct tile_run_rays *r)
{
    for (uint32_t p = 0; p < RAY_LANES / PACKET; p++)
        for (int i = 0; i < PACKET; i++) {
            r->packets[p].ray.tnear[i] = 0.0f;
            r->packets[p].ray.time[i] = 0.0f;
            r->packets[p].ray.mask[i] = ~0u;
            r->packets[p].ray.flags[i] = 0;
            r->packets[p].hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        }
}

int rays_create(struct tile_run_rays **rays, enum rays_distribution distribution, float distance,
                const struct kiln_batch *batch, struct kiln_error *error)
{
    const uint32_t samples = batch->samples;
    int status = kiln_allocate(rays, 1, sizeof **rays, "the rays of a pass", error);
    if (status == KILN_OK)
        status = kiln_allocate(&(*rays)->quarter_of, samples, sizeof(uint8_t), "the samples of a pass", error);
    for (uint32_t k = 0; status == KILN_OK && k < samples; k++)
        (*rays)->quarter_of[k] = (uint8_t)((uint64_t)k * RAY_QUARTERS / samples);
    const size_t numbers = (size_t)samples + 1;
    for (int d = 0; d < 4 && status == KILN_OK; d++) {
        status = kiln_allocate(&(*rays)->sobol[d], numbers, sizeof(uint32_t), "the samples of a pass", error);
        if (status == KILN_OK)
            status = kiln_allocate(&(*rays)->scrambled[d], numbers, sizeof(uint32_t), "the samples of a tile", error);
        for (uint32_t k = 0; status == KILN_OK && k < numbers; k++)
            (*rays)->sobol[d][k] = kiln_sobol(batch->first_sample + k, (uint32_t)d);
    }
    if (status != KILN_OK) {
        rays_destroy(rays);
        return status;
    }
    (*rays)->distribution = distribution;
    (*rays)->distance = distance;
    (*rays)->batch = batch;
    (*rays)->samples = samples;
    (*rays)->first_sample = batch->first_sample;
    (*rays)->shared_digits = kiln_shared_digits(samples);
    (*rays)->reuse = kiln_position_reuse(samples);
    start_packets(*rays);
    return KILN_OK;
}

KILN_CLONES static void scramble(uint32_t *restrict out, const uint32_t *restrict in, uint32_t count, uint32_t seed)
{
    for (uint32_t k = 0; k < count; k++)
        out[k] = kiln_owen_scramble(in[k], seed);
}

/* Returns the axis about which directions are drawn at a place of point j with geometric normal n. */
static struct kiln_vec3 axis_of(const struct tile_run_rays *r, uint32_t j, struct kiln_vec3 n)
{
    if (!r->frame.smooth || r->distribution == RAYS_UNIFORM)
        return n;
    const struct kiln_vec3 shading = frame_shading(&r->frame, j, n);
    return r->distribution == RAYS_SHADING ? shading : vec3_normalize(vec3_add(n, shading));
}

/* Makes position number `place` of point j, which several samples share. */
static float position_of(struct tile_run_rays *r, const struct embree_backend *b, uint32_t j, uint32_t place,
                         struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    return frame_position(&r->frame, b, j, kiln_unit_float(r->scrambled[2][place] ^ r->shift_s[j]),
                          kiln_unit_float(r->scrambled[3][place] ^ r->shift_t[j]), position, normal);
}

float rays_place(struct tile_run_rays *r, const struct embree_backend *b, uint32_t j, uint32_t k,
                 struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    return position_of(r, b, j, r->frame.whole[j] ? k : k / r->reuse, position, normal);
}

uint32_t rays_begin(struct tile_run_rays *r, const struct embree_backend *b, size_t tile_run, uint32_t stream,
                    unsigned wish)
{
    frame_build(&r->frame, b, tile_run, kiln_batch_points(r->batch, tile_run), wish | FRAME_LIFT);
    const uint32_t count = r->frame.count;
    if (count == 0)
        return 0;
    for (uint32_t d = 0; d < 4; d++)
        scramble(r->scrambled[d], r->sobol[d], r->samples + 1, kiln_gather_seed(r->frame.tile_key, stream, d));
    for (uint32_t j = 0; j < count; j++) { /* the first `count` lanes first: tables need their shifts */
        const uint32_t key = kiln_hash2(r->frame.key[j], stream);
        r->shift_u[j] = kiln_direction_shift(key, KILN_DIMENSION_U, r->shared_digits);
        r->shift_v[j] = kiln_direction_shift(key, KILN_DIMENSION_V, r->shared_digits);
        r->shift_s[j] = kiln_gather_shift(key, KILN_DIMENSION_S);
        r->shift_t[j] = kiln_gather_shift(key, KILN_DIMENSION_T);
    }
    r->guide = NULL;
    r->copies = RAY_LANES / count;
    if (r->copies > r->samples)
        r->copies = r->samples;
    r->lanes = r->copies * count;
    r->partial_lanes = 0;
    for (uint32_t l = 0; l < r->lanes; l++) {
        const uint32_t j = l % count;
        r->point[l] = j;
        r->weight[l] = 1.0f;
        r->copy[l] = l / count;
        r->shift_u[l] = r->shift_u[j], r->shift_v[l] = r->shift_v[j];
        r->shift_s[l] = r->shift_s[j], r->shift_t[l] = r->shift_t[j];
        r->chance[l] = kiln_gather_chance(kiln_hash2(r->frame.key[j], stream));
        r->partial[l] = !r->frame.whole[j];
        r->placed[l] = UINT32_MAX;
        for (int c = 0; c < 3; c++) {
            r->corner[c][l] = r->frame.origin[c][j];
            r->edge_s[c][l] = r->partial[l] ? 0.0f : r->frame.edge_s[c][j];
            r->edge_t[c][l] = r->partial[l] ? 0.0f : r->frame.edge_t[c][j];
            r->facet[c][l] = r->frame.normal[c][j];
        }
        const struct kiln_vec3 axis = axis_of(r, j, vec3(r->facet[0][l], r->facet[1][l], r->facet[2][l]));
        r->axis[0][l] = axis.x, r->axis[1][l] = axis.y, r->axis[2][l] = axis.z;
        if (r->partial[l])
            r->partial_lane[r->partial_lanes++] = l;
    }
    return (r->samples + r->copies - 1) / r->copies;
}

/* The scrambled random numbers of one sample, the same for all points. */
struct sample_numbers {
    uint32_t u, v, s, t;
};

/* As kiln_unit_float; through a signed number, which is converted eight at a time. */
static inline float unit_of(uint32_t fraction) { return ((float)(int32_t)(fraction >> 9) + 0.5f) * 0x1p-23f; }

/* Positions of lanes [begin, end), which take the same sample of their points. */
static inline void make_origins(struct tile_run_rays *restrict r, uint32_t begin, uint32_t end, struct sample_numbers k)
{
    for (uint32_t l = begin; l < end; l++) {
        const float s = unit_of(k.s ^ r->shift_s[l]), t = unit_of(k.t ^ r->shift_t[l]);
        for (int c = 0; c < 3; c++)
            r->origin[c][l] = r->corner[c][l] + s * r->edge_s[c][l] + t * r->edge_t[c][l];
    }
}

/* Sets the direction of lane l: z along the axis, `radius` from it, rotated by v of a circle. */
static inline void make_direction(struct tile_run_rays *restrict r, uint32_t l, float radius, float z, float v)
{
    const float turn = v - 0.5f, a = fabsf(turn);
    const float sine = copysignf(kiln_sine_turn(a < 0.5f - a ? a : 0.5f - a), turn);
    const float x = radius * kiln_sine_turn(0.25f - a), y = radius * sine;
    const float nx = r->axis[0][l], ny = r->axis[1][l], nz = r->axis[2][l];
    const float sign = copysignf(1.0f, nz), f = -1.0f / (sign + nz), g = nx * ny * f; /* kiln_basis */
    r->direction[0][l] = x * (1.0f + sign * nx * nx * f) + y * g + z * nx;
    r->direction[1][l] = x * sign * g + y * (sign + ny * ny * f) + z * ny;
    r->direction[2][l] = -x * sign * nx - y * ny + z * nz;
    r->cosine[l] = z;
}

KILN_CLONES static void make_cosine_rays(struct tile_run_rays *restrict r, uint32_t begin, uint32_t end,
                                         struct sample_numbers k)
{
    make_origins(r, begin, end, k);
    for (uint32_t l = begin; l < end; l++) {
        const float u = unit_of(k.u ^ r->shift_u[l]), v = unit_of(k.v ^ r->shift_v[l]);
        make_direction(r, l, sqrtf(u), sqrtf(1.0f - u), v);
    }
}

KILN_CLONES static void make_guided_rays(struct tile_run_rays *restrict r, const float *restrict guide, uint32_t begin,
                                         uint32_t end, struct sample_numbers k)
{
    make_origins(r, begin, end, k);
    for (uint32_t l = begin; l < end; l++) {
        float u = unit_of(k.u ^ r->shift_u[l]), v = unit_of(k.v ^ r->shift_v[l]);
        uint32_t cell;
        r->weight[l] = kiln_guide_warp(guide, &u, &v, &cell);
        make_direction(r, l, sqrtf(u), sqrtf(1.0f - u), v);
    }
}

KILN_CLONES static void make_uniform_rays(struct tile_run_rays *restrict r, uint32_t begin, uint32_t end,
                                          struct sample_numbers k)
{
    make_origins(r, begin, end, k);
    for (uint32_t l = begin; l < end; l++) {
        const float u = unit_of(k.u ^ r->shift_u[l]), v = unit_of(k.v ^ r->shift_v[l]);
        make_direction(r, l, sqrtf(u * (2.0f - u)), 1.0f - u, v);
    }
}

static void fill_packets(struct tile_run_rays *r, uint32_t lanes)
{
    for (uint32_t p = 0, l = 0; l < lanes; p++, l += PACKET) {
        struct RTCRayHit8 *packet = &r->packets[p];
        memcpy(packet->ray.org_x, &r->origin[0][l], sizeof packet->ray.org_x);
        memcpy(packet->ray.org_y, &r->origin[1][l], sizeof packet->ray.org_y);
        memcpy(packet->ray.org_z, &r->origin[2][l], sizeof packet->ray.org_z);
        memcpy(packet->ray.dir_x, &r->direction[0][l], sizeof packet->ray.dir_x);
        memcpy(packet->ray.dir_y, &r->direction[1][l], sizeof packet->ray.dir_y);
        memcpy(packet->ray.dir_z, &r->direction[2][l], sizeof packet->ray.dir_z);
        for (int i = 0; i < PACKET; i++) {
            packet->ray.tfar[i] = r->distance;
            packet->hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        }
    }
}

/* Copies to lane l the position of lane `from` of the same point. */
static void place_as(struct tile_run_rays *r, uint32_t l, uint32_t from)
{
    for (int c = 0; c < 3; c++) {
        r->corner[c][l] = r->corner[c][from];
        r->axis[c][l] = r->axis[c][from];
        r->facet[c][l] = r->facet[c][from];
    }
}

/* Makes position `number` of its point for lane l. */
static void place_anew(struct tile_run_rays *r, const struct embree_backend *b, uint32_t l, uint32_t number)
{
    struct kiln_vec3 p, n;
    (void)position_of(r, b, r->point[l], number, &p, &n);
    const struct kiln_vec3 axis = axis_of(r, r->point[l], n);
    r->corner[0][l] = p.x, r->corner[1][l] = p.y, r->corner[2][l] = p.z;
    r->axis[0][l] = axis.x, r->axis[1][l] = axis.y, r->axis[2][l] = axis.z;
    r->facet[0][l] = n.x, r->facet[1][l] = n.y, r->facet[2][l] = n.z;
}

/* Sets the positions of lanes whose points are not whole squares, for `copies` samples a point from `first` on. A
 * lane's position may exist already, in an earlier lane of its point, or in the last one of the previous step. */
static void place(struct tile_run_rays *r, const struct embree_backend *b, uint32_t first, uint32_t copies)
{
    const uint32_t count = r->frame.count;
    for (uint32_t i = 0; i < r->partial_lanes; i++) {
        const uint32_t l = r->partial_lane[i], number = (first + r->copy[l]) / r->reuse;
        if (r->copy[l] >= copies || r->placed[l] == number)
            continue;
        const uint32_t before = r->copy[l] > 0 ? l - count : r->lanes - count + l;
        if (r->placed[before] == number)
            place_as(r, l, before);
        else
            place_anew(r, b, l, number);
        r->placed[l] = number;
    }
}

uint32_t rays_make(struct tile_run_rays *r, const struct embree_backend *b, uint32_t step)
{
    const uint32_t count = r->frame.count, first = step * r->copies;
    const uint32_t copies = r->samples - first < r->copies ? r->samples - first : r->copies;
    place(r, b, first, copies);
    for (uint32_t c = 0; c < copies; c++) {
        const struct sample_numbers numbers = {r->scrambled[0][first + c], r->scrambled[1][first + c],
                                               r->scrambled[2][first + c], r->scrambled[3][first + c]};
        if (r->distribution == RAYS_UNIFORM)
            make_uniform_rays(r, c * count, (c + 1) * count, numbers);
        else if (r->guide != NULL)
            make_guided_rays(r, r->guide, c * count, (c + 1) * count, numbers);
        else
            make_cosine_rays(r, c * count, (c + 1) * count, numbers);
    }
    for (uint32_t l = 0; l < copies * count && embree_blends(b); l++)
        r->seed[l] = kiln_gather_ray_seed(r->chance[l], rays_sample(r, step, l));
    fill_packets(r, copies * count);
    return copies * count;
}

static void send_lane(struct tile_run_rays *r, uint32_t l)
{
    struct RTCRayHit8 *packet = &r->packets[l / PACKET];
    packet->ray.dir_x[l % PACKET] = r->direction[0][l];
    packet->ray.dir_y[l % PACKET] = r->direction[1][l];
    packet->ray.dir_z[l % PACKET] = r->direction[2][l];
}

void rays_turn(struct tile_run_rays *r, uint32_t l, float radius, float turn)
{
    make_direction(r, l, radius, sqrtf(1.0f - radius * radius), turn);
    send_lane(r, l);
}

bool rays_aim(struct tile_run_rays *r, uint32_t l, struct kiln_vec3 d)
{
    const float cosine = d.x * r->axis[0][l] + d.y * r->axis[1][l] + d.z * r->axis[2][l];
    if (!(cosine > 0.0f)) {
        r->packets[l / PACKET].ray.tfar[l % PACKET] = -1.0f; /* negative length: Embree ignores such a ray */
        return false;
    }
    r->direction[0][l] = d.x, r->direction[1][l] = d.y, r->direction[2][l] = d.z;
    r->cosine[l] = cosine;
    send_lane(r, l);
    return true;
}

/* Mask of packet p's lanes: -1 for a ray, 0 for none. */
static const int *lanes_of(uint32_t p, uint32_t lanes, int some[PACKET])
{
    static const int all[PACKET] __attribute__((aligned(32))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    if ((p + 1) * PACKET <= lanes)
        return all;
    for (uint32_t i = 0; i < PACKET; i++)
        some[i] = p * PACKET + i < lanes ? -1 : 0;
    return some;
}

void rays_trace_packet(struct tile_run_rays *r, const struct embree_backend *b, struct embree_context *context,
                       uint32_t p, uint32_t lanes)
{
    int some[PACKET] __attribute__((aligned(32)));
    const uint32_t l = p * PACKET;
    embree_nearest8(b, context, lanes_of(p, lanes, some), &r->packets[p], &r->seed[l], &r->tint[l]);
}

void rays_trace(struct tile_run_rays *r, const struct embree_backend *b, struct embree_context *context, uint32_t lanes)
{
    for (uint32_t p = 0; p * PACKET < lanes; p++)
        rays_trace_packet(r, b, context, p, lanes);
}

void rays_block(struct tile_run_rays *r, const struct embree_backend *b, struct embree_context *context, uint32_t lanes)
{
    int some[PACKET] __attribute__((aligned(32)));
    for (uint32_t p = 0, l = 0; l < lanes; p++, l += PACKET) /* a RTCRayHit8 begins with its RTCRay8 */
        embree_blocked8(b, context, lanes_of(p, lanes, some), &r->packets[p].ray, &r->seed[l]);
}

float rays_quarters_error(const double sum[RAY_QUARTERS], uint32_t samples)
{
    if (samples < RAY_QUARTERS)
        return 0.0f;
    double mean = 0.0, square = 0.0, value[RAY_QUARTERS];
    for (int i = 0; i < RAY_QUARTERS; i++) {
        value[i] = sum[i] * RAY_QUARTERS / samples;
        mean += value[i] / RAY_QUARTERS;
    }
    for (int i = 0; i < RAY_QUARTERS; i++)
        square += (value[i] - mean) * (value[i] - mean);
    return (float)(samples * sqrt(square / (RAY_QUARTERS * (RAY_QUARTERS - 1))));
}

struct RTCRayHit rays_lane(const struct tile_run_rays *r, uint32_t lane)
{
    const struct RTCRayHit8 *packet = &r->packets[lane / PACKET];
    const uint32_t i = lane % PACKET;
    return (struct RTCRayHit){.ray = {.org_x = packet->ray.org_x[i],
                                      .org_y = packet->ray.org_y[i],
                                      .org_z = packet->ray.org_z[i],
                                      .dir_x = packet->ray.dir_x[i],
                                      .dir_y = packet->ray.dir_y[i],
                                      .dir_z = packet->ray.dir_z[i],
                                      .tfar = packet->ray.tfar[i],
                                      .mask = ~0u},
                              .hit = {.Ng_x = packet->hit.Ng_x[i],
                                      .Ng_y = packet->hit.Ng_y[i],
                                      .Ng_z = packet->hit.Ng_z[i],
                                      .u = packet->hit.u[i],
                                      .v = packet->hit.v[i],
                                      .primID = packet->hit.primID[i],
                                      .geomID = packet->hit.geomID[i],
                                      .instID = {RTC_INVALID_GEOMETRY_ID}}};
}
