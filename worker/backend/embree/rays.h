/* Rays over the hemisphere of a tile run's points, in packets of similar direction. The rays of a step belong to one
 * sample of all points, or to a few consecutive samples, whose directions lie in one stratum of the hemisphere.
 * Everything is done RAY_LANES lanes at a time in structures of arrays; Embree gets packets of 8. */
#ifndef KILN_WORKER_BACKEND_EMBREE_RAYS_H
#define KILN_WORKER_BACKEND_EMBREE_RAYS_H

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/passage.h"

enum { RAY_LANES = 64, RAY_QUARTERS = 4 };

/* How directions are distributed. */
enum rays_distribution {
    /* with density cosine / pi about the axis half-way between geometric and shading normal, for irradiance about
     * either: see kiln_facet_weight */
    RAYS_HALF_WAY,
    RAYS_SHADING, /* with density cosine / pi about the shading normal; some may lie below the geometric surface */
    RAYS_UNIFORM  /* with density 1 / (2 pi) over the hemisphere of the geometric normal */
};

/* A thread's rays. Lane l of step i takes sample i * copies + copy[l] of point `point[l]` of the frame. */
struct tile_run_rays {
    struct tile_run_frame frame;
    enum rays_distribution distribution;
    float distance; /* m: no ray goes farther */
    const struct kiln_batch *batch;
    uint32_t samples, first_sample, copies, lanes, shared_digits;
    /* borrowed: guide that distributes the directions of RAYS_HALF_WAY; NULL: cosine only */
    const float *guide;
    uint8_t *quarter_of; /* quarter of each sample */
    uint32_t point[RAY_LANES], copy[RAY_LANES];
    /* data of the last step */
    float origin[3][RAY_LANES], direction[3][RAY_LANES]; /* offset included; unit */
    float axis[3][RAY_LANES], cosine[RAY_LANES];         /* axis of the directions' distribution; cosine with it */
    float weight[RAY_LANES];                             /* weight of the ray's light: 1, or 1 / density of the guide */
    float facet[3][RAY_LANES];                           /* geometric normal; only maintained if the frame is smooth */
    struct RTCRayHit8 packets[RAY_LANES / PACKET];
    /* for scenes with random hits or tints: seed of each lane's point, and of each ray; tint of each ray */
    uint32_t chance[RAY_LANES], seed[RAY_LANES];
    float tint[RAY_LANES][3];
    /* positions = corner + s edge_s + t edge_t, and digital shifts of random numbers */
    float corner[3][RAY_LANES], edge_s[3][RAY_LANES], edge_t[3][RAY_LANES];
    uint32_t shift_u[RAY_LANES], shift_v[RAY_LANES], shift_s[RAY_LANES], shift_t[RAY_LANES];
    /* points whose texel is not one square of one triangle: sample k uses position number k / reuse; `placed`: the
     * position that the lane has; UINT32_MAX: none yet */
    bool partial[RAY_LANES];
    uint32_t partial_lanes, partial_lane[RAY_LANES];
    uint32_t reuse, placed[RAY_LANES];
    /* Sobol' points of the pass, plain and scrambled for the tile: samples + 1 values each, since a single light gets
     * all samples, possibly rounded up */
    uint32_t *sobol[4], *scrambled[4];
};

/* Creates rays for the samples of a batch, which is borrowed. Destroy with rays_destroy. */
int rays_create(struct tile_run_rays **rays, enum rays_distribution distribution, float distance,
                const struct kiln_batch *batch, struct kiln_error *error);
void rays_destroy(struct tile_run_rays **rays);

/* Begins a tile run, with the random numbers of `stream`; `wish` is that of its frame. Returns the number of its steps,
 * 0 where no point is valid, or none is asked for. It sets no guide; the caller may set one afterwards. */
uint32_t rays_begin(struct tile_run_rays *rays, const struct embree_backend *b, size_t tile_run, uint32_t stream,
                    unsigned wish);
/* Number of a step's lanes; there are none for samples beyond the last. */
static inline uint32_t rays_lanes(const struct tile_run_rays *rays, uint32_t step)
{
    const uint32_t left = rays->samples - step * rays->copies;
    return (left < rays->copies ? left : rays->copies) * rays->frame.count;
}
/* Makes the rays of a step, the next one or the first. Returns rays_lanes. */
uint32_t rays_make(struct tile_run_rays *rays, const struct embree_backend *b, uint32_t step);
/* Change the direction of lane l of the last step. rays_turn sets it by its distance from the axis in the unit disc,
 * and its angle about the axis as a share of a circle. rays_aim sets a unit direction; if that is below the axis'
 * horizon, it returns false, and the ray is neither counted nor traced. The caller sets the weight. */
void rays_turn(struct tile_run_rays *rays, uint32_t l, float radius, float turn);
bool rays_aim(struct tile_run_rays *rays, uint32_t l, struct kiln_vec3 direction);
/* Finds the ray origin of sample k <= samples of point j, as frame_position, whose offset it returns. */
float rays_place(struct tile_run_rays *rays, const struct embree_backend *b, uint32_t j, uint32_t k,
                 struct kiln_vec3 *position, struct kiln_vec3 *normal);
/* Finds the nearest hits of the last step's rays, and their tints. */
void rays_trace(struct tile_run_rays *rays, const struct embree_backend *b, struct embree_context *context,
                uint32_t lanes);
/* Traces packet p alone. */
void rays_trace_packet(struct tile_run_rays *rays, const struct embree_backend *b, struct embree_context *context,
                       uint32_t p, uint32_t lanes);
/* Finds which of the last step's rays hit anything at all: see rays_is_blocked. */
void rays_block(struct tile_run_rays *rays, const struct embree_backend *b, struct embree_context *context,
                uint32_t lanes);
/* The number of the sample that lane `lane` of a step takes. */
static inline uint32_t rays_sample(const struct tile_run_rays *rays, uint32_t step, uint32_t lane)
{
    return rays->first_sample + step * rays->copies + rays->copy[lane];
}
/* Returns the quarter to which the lane's sample belongs. */
static inline uint32_t rays_quarter(const struct tile_run_rays *rays, uint32_t step, uint32_t lane)
{
    return rays->quarter_of[step * rays->copies + rays->copy[lane]];
}
static inline struct kiln_vec3 rays_origin(const struct tile_run_rays *rays, uint32_t lane)
{
    return vec3(rays->origin[0][lane], rays->origin[1][lane], rays->origin[2][lane]);
}
static inline struct kiln_vec3 rays_direction(const struct tile_run_rays *rays, uint32_t lane)
{
    return vec3(rays->direction[0][lane], rays->direction[1][lane], rays->direction[2][lane]);
}
static inline struct kiln_vec3 rays_facet(const struct tile_run_rays *rays, uint32_t lane)
{
    return vec3(rays->facet[0][lane], rays->facet[1][lane], rays->facet[2][lane]);
}
/* Returns the last ray of a lane, with its hit. */
struct RTCRayHit rays_lane(const struct tile_run_rays *rays, uint32_t lane);
static inline bool rays_is_blocked(const struct tile_run_rays *rays, uint32_t lane)
{
    return rays->packets[lane / PACKET].ray.tfar[lane % PACKET] < 0.0f;
}

/* Standard error of the sum of a point's `samples` samples, estimated from the sums of its four quarters. It exceeds
 * the error of the whole net, whose parts balance one another. */
float rays_quarters_error(const double sum[RAY_QUARTERS], uint32_t samples);

#endif
