#include "worker/backend/embree/shadow.h"

#include <math.h>

#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"
#include "worker/pass/groups.h"

void shadow_begin(struct shadow_packet *packet, struct shadow_sums *sums, uint32_t samples)
{
    packet->count = 0;
    packet->samples = samples;
    packet->sums = sums;
}

/* The mean of the choice's samples. */
static void add_to_group(struct shadow_packet *packet, uint32_t i)
{
    double *to = packet->groups + (size_t)packet->group[i] * KILN_GROUP_FLOATS;
    const double scale = 1.0 / (double)packet->samples;
    for (int c = 0; c < 3; c++) {
        to[c] += scale * packet->incident[i][c];
        to[3 + c] += scale * packet->irradiance[i][c];
    }
}

void shadow_trace(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context)
{
    double through[PACKET][3];
    embree_through8(b, context, packet->valid, &packet->rays, through);
    for (uint32_t i = 0; i < PACKET; i++) {
        if (packet->valid[i] == 0 || packet->rays.tfar[i] < 0.0f) /* -inf: something is in between */
            continue;
        for (int c = 0; c < 3 && embree_blends(b); c++) {
            packet->incident[i][c] *= through[i][c];
            packet->irradiance[i][c] *= through[i][c];
        }
        for (int c = 0; c < 3; c++) {
            packet->sums->incident[c] += packet->incident[i][c];
            packet->sums->irradiance[c] += packet->irradiance[i][c];
        }
        if (packet->groups != NULL)
            add_to_group(packet, i);
        const double *e = packet->irradiance[i];
        const double luminance = kiln_luminance(e);
        packet->sums->square += luminance * luminance;
        packet->sums->quarter[(uint64_t)packet->index[i] * 4 / packet->samples] += luminance;
    }
}

static void flush(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context)
{
    for (uint32_t i = 0; i < PACKET; i++)
        packet->valid[i] = i < packet->count ? -1 : 0;
    shadow_trace(packet, b, context);
    packet->count = 0;
}

void shadow_add(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context,
                struct kiln_vec3 p, const struct kiln_light_sample *sample, uint32_t index, double cosine,
                double shading_cosine)
{
    const uint32_t i = packet->count++;
    packet->index[i] = index;
    packet->rays.org_x[i] = p.x;
    packet->rays.org_y[i] = p.y;
    packet->rays.org_z[i] = p.z;
    packet->rays.dir_x[i] = (float)sample->direction.x;
    packet->rays.dir_y[i] = (float)sample->direction.y;
    packet->rays.dir_z[i] = (float)sample->direction.z;
    packet->rays.tnear[i] = 0.0f;
    packet->rays.tfar[i] = isfinite(sample->distance) ? shadow_limit(sample->distance, sample->backoff) : INFINITY;
    packet->rays.time[i] = 0.0f;
    packet->rays.mask[i] = ~0u;
    packet->rays.flags[i] = 0;
    for (int c = 0; c < 3; c++) {
        packet->incident[i][c] = sample->value[c] * cosine;
        packet->irradiance[i][c] = sample->value[c] * shading_cosine;
    }
    if (packet->count == PACKET)
        flush(packet, b, context);
}

void shadow_end(struct shadow_packet *packet, const struct embree_backend *b, struct embree_context *context)
{
    if (packet->count != 0)
        flush(packet, b, context);
}

double shadow_variance(const struct shadow_sums *sums, uint32_t samples)
{
    const double *e = sums->irradiance;
    const double mean = kiln_luminance(e) / samples;
    if (samples < 2)
        return mean * mean;
    if (samples >= KILN_QUARTERS_FROM) {
        double spread = 0.0;
        for (uint32_t q = 0; q < 4; q++) { /* if 4 does not divide their number, quarters differ by one sample */
            const uint32_t begin = kiln_quarter_first(q, samples), end = kiln_quarter_first(q + 1, samples);
            const double off = sums->quarter[q] / (end - begin) - mean;
            spread += off * off;
        }
        return spread / 12.0;
    }
    return fmax(0.0, sums->square / samples - mean * mean) / (samples - 1.0);
}
