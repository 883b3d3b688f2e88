#include "worker/backend/vulkan/techniques.h"

#include "worker/backend/mirror_images.h"
#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/light/emission.h"
#include "worker/pass/weighed.h"

static const char what[] = "what light paths are aimed at";

/* Memory layout expected by the kernels (shaders/techniques.glsl). */
struct root {
    struct kiln_gpu_land land;
    struct kiln_gpu_both both;
};
_Static_assert(offsetof(struct root, both) == sizeof(struct kiln_gpu_land), "one after the other");

/* Uploads arrays to the device, each to the next unused buffer; returns their addresses. */
struct uploading {
    struct vulkan_backend *b;
    size_t next;
    int status;
    struct kiln_error *error;
};

static uint64_t upload(struct uploading *u, const void *data, size_t bytes)
{
    if (u->status != KILN_OK || bytes == 0)
        return 0;
    struct gpu_buffer *buffer = &u->b->techniques.buffers[u->next++];
    u->status = gpu_buffer_of(u->b->gpu, buffer, data, bytes, what, u->error);
    return buffer->address;
}

static uint64_t upload_lamps(struct uploading *u, const struct kiln_aims *aims)
{
    struct kiln_gpu_lamp *lamps = NULL;
    if (u->status == KILN_OK)
        u->status = kiln_allocate(&lamps, aims->lamp_count, sizeof *lamps, what, u->error);
    for (size_t i = 0; u->status == KILN_OK && i < aims->lamp_count; i++)
        lamps[i] = (struct kiln_gpu_lamp){.kind = (uint32_t)aims->lamps[i].kind,
                                          .first = aims->lamps[i].first,
                                          .count = aims->lamps[i].count,
                                          .flux = (float)aims->lamps[i].flux};
    const uint64_t address = upload(u, lamps, aims->lamp_count * sizeof *lamps);
    kiln_free(&lamps);
    return address;
}
_Static_assert(KILN_GPU_LAMP_AREA == KILN_LAMP_AREA && KILN_GPU_LAMP_POINT == KILN_LAMP_POINT &&
                   KILN_GPU_LAMP_DIRECTIONAL == KILN_LAMP_DIRECTIONAL &&
                   KILN_GPU_LAMP_ENVIRONMENT == KILN_LAMP_ENVIRONMENT,
               "kinds of lamps");

static uint64_t upload_targets(struct uploading *u, const struct kiln_targets *all)
{
    struct kiln_gpu_target *targets = NULL;
    if (u->status == KILN_OK)
        u->status = kiln_allocate(&targets, all->count, sizeof *targets, what, u->error);
    for (size_t i = 0; u->status == KILN_OK && i < all->count; i++)
        targets[i] = (struct kiln_gpu_target){.centre = vec3_of(all->all[i].centre),
                                              .low = vec3_of(all->all[i].low),
                                              .high = vec3_of(all->all[i].high),
                                              .radius = (float)all->all[i].radius,
                                              .area = (float)all->all[i].area,
                                              .listed = (uint32_t)all->all[i].first,
                                              .count = (uint32_t)all->all[i].count};
    const uint64_t address = upload(u, targets, all->count * sizeof *targets);
    kiln_free(&targets);
    return address;
}

/* Shares, which rise up to 1. */
static uint64_t upload_shares(struct uploading *u, const double *shares, size_t count)
{
    float *rounded = NULL;
    if (u->status == KILN_OK)
        u->status = kiln_allocate(&rounded, count, sizeof *rounded, what, u->error);
    for (size_t i = 0; u->status == KILN_OK && i < count; i++)
        rounded[i] = (float)shares[i];
    const uint64_t address = upload(u, rounded, count * sizeof *rounded);
    kiln_free(&rounded);
    return address;
}

static uint64_t upload_even(struct uploading *u, const struct kiln_aims *aims)
{
    uint64_t *even = NULL;
    if (u->status == KILN_OK)
        u->status = kiln_allocate_bare(&even, aims->count, sizeof *even, what, u->error);
    const size_t count = u->status == KILN_OK ? aims->count : 0;
#pragma omp parallel for num_threads((int)u->b->threads) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++)
        even[i] = kiln_aims_even(aims, i);
    const uint64_t address = upload(u, even, aims->count * sizeof *even);
    kiln_free(&even);
    return address;
}

/* Describes the number of lights, and, if light is weighted, the light tree with links to parents. */
static struct kiln_gpu_both describe_lights(struct uploading *u, const struct kiln_lights *lights,
                                            const struct kiln_caustic_techniques *techniques,
                                            const struct kiln_gpu_both *under_way)
{
    struct kiln_gpu_both both = {0};
    if (under_way != NULL)
        both = *under_way;
    both.lights = (uint32_t)(lights->area_count + lights->point_count + lights->directional_count + 1);
    if (techniques == NULL)
        return both;
    const struct kiln_emission *e = techniques->emission;
    both.parents = upload(u, e->parent, lights->node_count * sizeof *e->parent);
    both.leaves = upload(u, e->leaf, e->count * sizeof *e->leaf);
    return both;
}

int vulkan_techniques_create(struct vulkan_backend *b, const struct kiln_aims *aims,
                             const struct kiln_caustic_techniques *techniques, const struct kiln_gpu_both *under_way,
                             struct kiln_error *error)
{
    const size_t triangles = b->params.geometry->triangle_count;
    struct root root;
    struct uploading u = {.b = b, .error = error};
    root.land = (struct kiln_gpu_land){
        .lamps = upload_lamps(&u, aims),
        .targets = upload_targets(&u, &aims->targets),
        .first = upload(&u, aims->first, (aims->count + 1) * sizeof *aims->first),
        .until = upload_shares(&u, aims->until, aims->lights->area_count),
        .lamp_of = upload(&u, aims->lamp_of, aims->lights->area_count * sizeof *aims->lamp_of),
        .even = upload_even(&u, aims),
        .triangles = upload(&u, aims->targets.triangles, aims->targets.listed * sizeof *aims->targets.triangles),
        .shares = upload_shares(&u, aims->targets.until, aims->targets.listed),
        .of_triangle = upload(&u, aims->targets.of_triangle, triangles * sizeof *aims->targets.of_triangle),
        .spheres = b->spheres[VULKAN_SPHERES_ROOT].address,
        .paths = aims->paths,
        .aim_count = (uint32_t)aims->count,
        .target_count = (uint32_t)aims->targets.count,
        .centre = vec3_of(aims->centre),
        .radius = (float)aims->radius};
    root.both = describe_lights(&u, aims->lights, techniques, under_way);
    if (techniques != NULL) {
        root.land.mis = (uint32_t)techniques->mis;
        root.land.iterations = (float)techniques->iterations;
        if (techniques->images != NULL)
            root.land.plane_of =
                upload(&u, techniques->images->plane_of, triangles * sizeof *techniques->images->plane_of);
    }
    b->techniques.both = upload(&u, &root, sizeof root) + offsetof(struct root, both);
    return u.status;
}

void vulkan_techniques_release(struct vulkan_backend *b)
{
    for (size_t i = 0; i < VULKAN_TECHNIQUE_BUFFERS; i++)
        gpu_buffer_destroy(b->gpu, &b->techniques.buffers[i]);
    gpu_buffer_destroy(b->gpu, &b->techniques.areas);
}
