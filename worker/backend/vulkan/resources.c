#include "worker/backend/vulkan/resources.h"

#include <string.h>

#include "worker/backend/vulkan/groups.h"
#include "worker/backend/vulkan/kept_rows.h"
#include "worker/scene/radiance_probes.h"

/* ---- the surface, and tile runs of others ---- */

/* Back to the own points. */
static void leave_others(struct vulkan_backend *b)
{
    if (b->own_points == NULL)
        return;
    vulkan_points_destroy(&b->points);
    b->points = b->own_points;
    b->own_points = NULL;
    b->surface = b->own;
}

static void clear_surface(struct vulkan_backend *b)
{
    leave_others(b);
    vulkan_points_destroy(&b->points);
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->store_arrays[i]);
    gpu_buffer_destroy(b->gpu, &b->radiosity_buffer);
}

/* Copies the store's arrays to the device. */
static int upload_store(struct vulkan_backend *b, const struct kiln_store *store, struct kiln_error *error)
{
    struct kiln_store_array arrays[KILN_STORE_ARRAYS];
    uint64_t addresses[KILN_STORE_ARRAYS];
    int status = KILN_OK;
    kiln_store_arrays(store, arrays);
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++) {
        const struct kiln_store_array *array = &arrays[i];
        if (status == KILN_OK)
            status = gpu_buffer_of(b->gpu, &b->store_arrays[i], array->data, array->bytes, array->what, error);
        addresses[i] = b->store_arrays[i].address;
    }
    _Static_assert(sizeof b->layout.store == sizeof addresses, "the store's arrays");
    memcpy(&b->layout.store, addresses, sizeof addresses);
    return status;
}

static int upload_surface(struct vulkan_backend *b, struct kiln_error *error)
{
    struct kiln_store store;
    clear_surface(b);
    const struct kiln_surface *s = b->own;
    kiln_store_build(&store, s, b->params.geometry);
    int status;
    KILN_TRY(upload_store(b, &store, error));
    KILN_TRY(gpu_buffer_create(b->gpu, &b->radiosity_buffer, kiln_store_count(&store) * sizeof(uint64_t), GPU_DEVICE,
                               "the radiosity of all points", error));
    KILN_TRY(vulkan_points_create(&b->points, b->gpu, &b->params, s, &b->materials, error));
end:
    b->layout.object_count = s->object_count;
    b->layout.slot_last = s->bricks != NULL ? s->slot_count - 1 : 0;
    b->constants[VULKAN_HAS_DIVIDED] = s->divided_count > 0;
    b->constants[VULKAN_HAS_OCTREE] = s->bricks != NULL;
    b->layout.radiosity = b->radiosity_buffer.address;
    return status == KILN_OK ? vulkan_upload_root(b, error) : status;
}

/* Switches to the points of other ranks, if there are some; else back to the own points. */
static int enter_others(struct vulkan_backend *b, struct kiln_error *error)
{
    struct vulkan_points *points;
    const struct kiln_others *others = &b->base.given.others;
    leave_others(b);
    if (others->surface == NULL)
        return KILN_OK;
    const int status = vulkan_points_of_others(&points, b->points, others, error);
    if (status != KILN_OK)
        return status;
    b->own_points = b->points;
    b->points = points;
    b->surface = others->surface;
    return KILN_OK;
}

/* Uploads radiosity. What was given before the surface belongs to another surface, and stays where it is. */
static int upload_radiosity(struct vulkan_backend *b, struct kiln_error *error)
{
    if (b->radiosity == NULL)
        return KILN_OK;
    return gpu_fill(b->gpu, &b->radiosity_buffer, 0, b->radiosity, b->surface->point_count * sizeof *b->radiosity,
                    error);
}

/* ---- radiance probes ---- */

static void clear_probes(struct vulkan_backend *b)
{
    gpu_buffer_destroy(b->gpu, &b->probes_root);
    gpu_buffer_destroy(b->gpu, &b->probe_positions);
    gpu_buffer_destroy(b->gpu, &b->probe_data);
}

/* Copies the probes to the device, in the place of those before. */
static int upload_probes(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_radiance_probes *p = b->probes;
    if (b->points != NULL)
        vulkan_points_forget_probes(b->points);
    clear_probes(b);
    if (p == NULL)
        return KILN_OK;
    const size_t count = (size_t)kiln_probes_count(&p->grid);
    int status;
    KILN_TRY(gpu_buffer_of(b->gpu, &b->probe_positions, p->positions, count * sizeof *p->positions,
                           "the positions of radiance probes", error));
    KILN_TRY(gpu_buffer_of(b->gpu, &b->probe_data, p->data, count * p->grid.floats * sizeof *p->data,
                           "the radiance of probes", error));
    const struct kiln_gpu_radiance_probes root = {
        .grid = p->grid, .positions = b->probe_positions.address, .data = b->probe_data.address};
    KILN_TRY(gpu_buffer_of(b->gpu, &b->probes_root, &root, sizeof root, "radiance probes", error));
end:
    return status;
}

/* ---- light ---- */

/* Uploads lights and materials again. Kernels are kept, unless there are kinds of lights that they were compiled
 * without. */
static int upload_light(struct vulkan_backend *b, struct kiln_error *error)
{
    vulkan_bidirectional_release(b);
    vulkan_lights_destroy(b->gpu, &b->lights);
    vulkan_materials_destroy(b->gpu, &b->materials);
    int status =
        vulkan_materials_create(b->gpu, &b->params, b->all_materials, &b->materials, &b->layout.materials, error);
    if (status == KILN_OK)
        status = vulkan_lights_create(b->gpu, b->params.lights, b->float64, &b->lights, &b->layout.lights, error);
    if (status == KILN_OK && (b->lights.kinds & ~b->constants[VULKAN_LIGHT_KINDS]) != 0) {
        b->constants[VULKAN_LIGHT_KINDS] |= b->lights.kinds;
        vulkan_forget_kernels(b);
    }
    return status == KILN_OK ? vulkan_upload_root(b, error) : status;
}

/* ---- the table ---- */

/* For each resource: how it is uploaded, replacing the old one, and how it is freed. NULL: passes read it on the host.
 */
static const struct {
    int (*bring)(struct vulkan_backend *b, struct kiln_error *error);
    void (*release)(struct vulkan_backend *b);
} resources[KILN_RESOURCE_COUNT] = {
    [KILN_RESOURCE_surface] = {upload_surface, clear_surface},
    [KILN_RESOURCE_others] = {enter_others, leave_others},
    [KILN_RESOURCE_radiosity] = {upload_radiosity, NULL},
    [KILN_RESOURCE_probes] = {upload_probes, clear_probes},
    [KILN_RESOURCE_light] = {upload_light, NULL},
    [KILN_RESOURCE_rows] = {NULL, vulkan_rows_release},
    [KILN_RESOURCE_groups] = {NULL, vulkan_groups_release},
};

int vulkan_resource_bring(struct vulkan_backend *b, enum kiln_resource_index index, struct kiln_error *error)
{
    return resources[index].bring != NULL ? resources[index].bring(b, error) : KILN_OK;
}

int vulkan_resources_bring(struct vulkan_backend *b, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int i = 0; i < KILN_RESOURCE_COUNT && status == KILN_OK; i++)
        if (kiln_resource_is_given(&b->base.given, (enum kiln_resource_index)i))
            status = vulkan_resource_bring(b, (enum kiln_resource_index)i, error);
    return status;
}

void vulkan_resources_release(struct vulkan_backend *b)
{
    for (int i = 0; i < KILN_RESOURCE_COUNT; i++)
        if (resources[i].release != NULL)
            resources[i].release(b);
}
