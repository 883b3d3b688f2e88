/* Shadow rays in packets of 8; their results are summed in the order of the rays. */
#ifndef KILN_WORKER_BACKEND_EMBREE_SHADOW_H
#define KILN_WORKER_BACKEND_EMBREE_SHADOW_H

#include <math.h>

#include "shaders/shared/area_light.h"
#include "worker/backend/embree/passage.h"

/* Light of the samples of one choice of light: plain sums, to be divided by the number of samples. */
struct shadow_sums {
    double incident[3], irradiance[3];
    double quarter[4]; /* luminance of irradiance, of each quarter of the samples */
    double square;     /* sum of squared luminances */
};

struct shadow_packet {
    struct RTCRay8 rays __attribute__((aligned(32)));
    int valid[PACKET] __attribute__((aligned(32)));    /* -1: a ray; 0: none */
    double incident[PACKET][3], irradiance[PACKET][3]; /* contribution of a sample if unoccluded */
    uint32_t count, samples, index[PACKET];
    struct shadow_sums *sums;
    /* light of groups (worker/pass/groups.h): KILN_GROUP_FLOATS a group, NULL: not requested; and the group of each
     * sample */
    double *groups;
    uint32_t group[PACKET];
};

/* Starts a choice with `samples` samples, whose light is added to `sums`. */
void shadow_begin(struct shadow_packet *packet, struct shadow_sums *sums, uint32_t samples);
/* Adds the ray of sample `index` from p. `cosine`: of the geometric normal, times the share that the point takes up
 * (frame_taken_up); `shading_cosine`: of the shading normal. */
void shadow_add(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context,
                struct kiln_vec3 p, const struct kiln_light_sample *sample, uint32_t index, double cosine,
                double shading_cosine);
void shadow_end(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context);
/* Traces the valid ones of a packet that was filled as a whole, and sums up. */
void shadow_trace(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context);
/* Changes direction and distance of a sample drawn at `place` so that the ray from `start` reaches the same point of
 * the light. */
static inline void shadow_aim(struct kiln_light_sample *s, struct kiln_dvec3 place, struct kiln_dvec3 start)
{
    if (!isfinite(s->distance))
        return;
    const struct kiln_dvec3 to = dvec3_sub(dvec3_add(place, dvec3_scale(s->direction, s->distance)), start);
    const double distance = dvec3_length(to);
    if (!(distance > 0.0))
        return;
    s->direction = dvec3_scale(to, 1.0 / distance);
    s->distance = distance;
}

/* Length of a shadow ray towards a light at this distance. */
static inline float shadow_limit(double distance, double backoff)
{
    return (float)((distance - backoff) * KILN_SHADOW_LENGTH);
}

/* Variance of the mean luminance, estimated from the spread of four quarters, each a net of its own. It exceeds that of
 * the whole net, whose parts balance one another. Below 8 samples they are treated as independent. */
double shadow_variance(const struct shadow_sums *sums, uint32_t samples);

#endif
