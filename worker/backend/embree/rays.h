/* Rays over the hemisphere of a tile run's points, in packets that go one way: a step's rays are of one sample of all
 * points, or of a few consecutive ones, whose directions lie in one stratum of the hemisphere. Everything is done
 * RAY_LANES lanes at a time in structures of arrays; Embree gets packets of 8. */
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
    /* borrowed: the guide by which directions of RAYS_HALF_WAY are drawn; NULL: by the cosine alone */
    const float *guide;
    uint8_t *quarter_of; /* of a sample */
    uint32_t point[RAY_LANES], copy[RAY_LANES];
    /* of the step made last */
    float origin[3][RAY_LANES], direction[3][RAY_LANES]; /* offset included; unit */
    float axis[3][RAY_LANES], cosine[RAY_LANES];         /* what directions are drawn about; with it */
    float weight[RAY_LANES];                             /* of what the ray finds: 1, or 1 / density of the guide */
    float facet[3][RAY_LANES];                           /* geometric normal; kept up where the frame is smooth */
    struct RTCRayHit8 packets[RAY_LANES / PACKET];
    /* scenes that leave hits to chance, or tint them: what chance hangs on, of each lane's point and of each ray; and
     * each ray's tint */
    uint32_t chance[RAY_LANES], seed[RAY_LANES];
    float tint[RAY_LANES][3];
    /* positions = corner + s edge_s + t edge_t, and digital shifts of random numbers */
    float corner[3][RAY_LANES], edge_s[3][RAY_LANES], edge_t[3][RAY_LANES];
    uint32_t shift_u[RAY_LANES], shift_v[RAY_LANES], shift_s[RAY_LANES], shift_t[RAY_LANES];
    /* points whose texel is not one square of one triangle: sample k takes the (k / reuse)-th position; `placed`: the
     * one that the lane has; UINT32_MAX: none yet */
    bool partial[RAY_LANES];
    uint32_t partial_lanes, partial_lane[RAY_LANES];
    uint32_t reuse, placed[RAY_LANES];
    /* Sobol' points of the pass, and scrambled for the tile: samples + 1 values each, for a lone light gets all
     * samples, rounded up at most */
    uint32_t *sobol[4], *scrambled[4];
};

/* Rays with the samples of a batch, which is borrowed. Destroy with rays_destroy. */
int rays_create(struct tile_run_rays **rays, enum rays_distribution distribution, float distance,
                const struct kiln_batch *batch, struct kiln_error *error);
void rays_destroy(struct tile_run_rays **rays);

/* Begins a tile run, with the random numbers of `stream`; `wish` is that of its frame. Returns the number of its steps,
 * 0 where no point is valid, or none is asked for. There is no guide; who wants one sets it afterwards. */
uint32_t rays_begin(struct tile_run_rays *rays, const struct embree_backend *b, size_t tile_run, uint32_t stream,
                    unsigned wish);
/* Number of a step's lanes. Samples that do not exist have none. */
static inline uint32_t rays_lanes(const struct tile_run_rays *rays, uint32_t step)
{
    const uint32_t left = rays->samples - step * rays->copies;
    return (left < rays->copies ? left : rays->copies) * rays->frame.count;
}
/* Makes the rays of a step, the next one or the first. Returns rays_lanes. */
uint32_t rays_make(struct tile_run_rays *rays, const struct embree_backend *b, uint32_t step);
/* Gives lane l of the step made last another direction: so far from the axis, over 1, and turned so far about it, of a
 * circle; or this one, unit, which does not count as a ray and is not traced (false) where it is not above the axis'
 * horizon. The weight is the caller's. */
void rays_turn(struct tile_run_rays *rays, uint32_t l, float radius, float turn);
bool rays_aim(struct tile_run_rays *rays, uint32_t l, struct kiln_vec3 direction);
/* Where sample k <= samples of point j starts, as its ray does: as frame_position, whose offset it returns. */
float rays_place(struct tile_run_rays *rays, const struct embree_backend *b, uint32_t j, uint32_t k,
                 struct kiln_vec3 *position, struct kiln_vec3 *normal);
/* Finds the nearest hits of the rays made last, and their tints. */
void rays_trace(struct tile_run_rays *rays, const struct embree_backend *b, struct embree_context *context,
                uint32_t lanes);
/* The same of packet p alone. */
void rays_trace_packet(struct tile_run_rays *rays, const struct embree_backend *b, struct embree_context *context,
                       uint32_t p, uint32_t lanes);
/* Finds which of the rays made last meet anything at all: see rays_is_blocked. */
void rays_block(struct tile_run_rays *rays, const struct embree_backend *b, struct embree_context *context,
                uint32_t lanes);
/* The number of the sample that lane `lane` of a step takes. */
static inline uint32_t rays_sample(const struct tile_run_rays *rays, uint32_t step, uint32_t lane)
{
    return rays->first_sample + step * rays->copies + rays->copy[lane];
}
/* The quarter of the samples that it is of. */
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
/* The ray of a lane made last, with what it has hit. */
struct RTCRayHit rays_lane(const struct tile_run_rays *rays, uint32_t lane);
static inline bool rays_is_blocked(const struct tile_run_rays *rays, uint32_t lane)
{
    return rays->packets[lane / PACKET].ray.tfar[lane % PACKET] < 0.0f;
}

/* Standard error of the sum of a point's `samples` samples, by the spread of the means of its four quarters, whose sums
 * are given: more than the error of the whole net, whose parts balance one another. */
float rays_quarters_error(const double sum[RAY_QUARTERS], uint32_t samples);

#endif
