/* The directions pass (worker/pass/directions.h), without gloss: runs shaders/directions.comp, or bright.comp if rays
 * go to bright patches, and gather_reduce.comp. */
#include "worker/pass/directions.h"

#include "worker/backend/vulkan/bright.h"
#include "worker/base/memory.h"

static const struct vulkan_shader directions_shader = {
    .name = "gather by directions", .compute = VULKAN_CODE(directions), .pipeline = VULKAN_CODE(directions_pipeline)};

static const struct vulkan_shader bright_shader = {.name = "gather from bright patches",
                                                   .compute = VULKAN_CODE(bright),
                                                   .pipeline = VULKAN_CODE(bright_pipeline),
                                                   .compute_float = VULKAN_CODE(bright_float),
                                                   .pipeline_float = VULKAN_CODE(bright_pipeline_float)};

_Static_assert(sizeof(struct kiln_gpu_directions_push) ==
                   sizeof(struct kiln_gpu_hemisphere_push) + 2 * sizeof(uint64_t),
               "the pass's own push constants come last");

struct directions_run {
    const struct kiln_directions_parameters *p;
    uint64_t own[2]; /* lights, set: struct kiln_gpu_directions_push */
};

static int bring_lights(struct vulkan_backend *b, struct directions_run *r, struct kiln_error *error)
{
    static const char what[] = "what patches emit";
    const size_t bytes = (size_t)b->surface->point_count * sizeof *r->p->radiosity;
    r->own[0] = b->radiosity_buffer.address;
    if (r->p->radiosity == NULL)
        return KILN_OK;
    int status = vulkan_grow_buffer(b, &b->row_lights, bytes, GPU_DEVICE, what, error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->row_lights, 0, r->p->radiosity, bytes, error);
    r->own[0] = b->row_lights.address;
    return status;
}

static int bring_set(struct vulkan_backend *b, struct directions_run *r, struct kiln_error *error)
{
    static const char what[] = "a set of directions";
    const uint32_t count = r->p->set != NULL ? r->p->set_count : 0;
    float *quads = NULL;
    int status = kiln_allocate(&quads, 4 * (1 + (size_t)count), sizeof *quads, what, error);
    if (status != KILN_OK)
        return status;
    quads[0] = (float)r->p->scale;
    quads[1] = count > 0 ? 1.0f : 0.0f;
    for (uint32_t k = 0; k < count; k++) {
        float *to = quads + 4 * (1 + (size_t)k);
        to[0] = r->p->set[k].radius;
        to[1] = r->p->set[k].turn;
        to[2] = r->p->set[k].weight;
    }
    const size_t bytes = 4 * (1 + (size_t)count) * sizeof *quads;
    status = vulkan_grow_buffer(b, &b->direction_set, bytes, GPU_DEVICE, what, error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->direction_set, 0, quads, bytes, error);
    r->own[1] = b->direction_set.address;
    kiln_free(&quads);
    return status;
}

/* vulkan_hemisphere.prepare */
static int prepare(struct vulkan_backend *b, void *context, struct kiln_error *error)
{
    struct directions_run *r = context;
    const int status = bring_lights(b, r, error);
    if (status != KILN_OK)
        return status;
    return r->p->bright != NULL ? vulkan_bright_prepare(b, r->p->bright, error) : bring_set(b, r, error);
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    struct directions_run r = {.p = parameters};
    if (r.p->set != NULL && r.p->set_count != batch->samples)
        return kiln_fail(error, KILN_USAGE, "a set of %u directions is for as many samples, not %u", r.p->set_count,
                         batch->samples);
    struct vulkan_hemisphere pass = vulkan_gather_pass(b, batch, r.own);
    pass.pass = &kiln_pass_directions;
    pass.shader = &directions_shader;
    pass.pace = KILN_PASS_INDEX_directions;
    pass.prepare = prepare;
    pass.context = &r;
    if (r.p->bright != NULL) {
        pass.shader = &bright_shader;
        pass.bring = vulkan_bright_bring;
        pass.parameters = r.p;
        pass.moved_bytes = vulkan_bright_bytes(r.p->bright);
    }
    return vulkan_hemisphere_run(b, &pass, batch, rays, error);
}

static bool takes(const struct vulkan_backend *b, const void *parameters)
{
    (void)parameters;
    return b->probes == NULL && !b->materials.gloss;
}

static void give_back(struct vulkan_backend *b)
{
    gpu_buffer_destroy(b->gpu, &b->row_lights);
    gpu_buffer_destroy(b->gpu, &b->direction_set);
    vulkan_bright_release(b);
}

const struct vulkan_pass vulkan_pass_directions = {.run = run, .takes = takes, .release = give_back};
