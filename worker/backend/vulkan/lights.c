#include "worker/backend/vulkan/lights.h"

#include <string.h>

#include "worker/base/memory.h"
#include "worker/light/tree.h"

#define KILN_STORED_REAL double
#define KILN_STORED_NAME(name) name
#include "shaders/shared/layout_light_real.h"
#undef KILN_STORED_REAL
#undef KILN_STORED_NAME
#define KILN_STORED_REAL float
#define KILN_STORED_NAME(name) name##_float
#include "shaders/shared/layout_light_real.h"

/* Layout of a struct: number of reals at its beginning, and of words after them. */
struct shape {
    size_t reals, words, size, float_size;
};
#define SHAPE(name, first_word, word_count)                                                                            \
    {                                                                                                                  \
        offsetof(struct name, first_word) / sizeof(double), word_count, sizeof(struct name),                           \
            sizeof(struct name##_float)                                                                                \
    }
#define SHAPE_HOLDS(name, first_word, word_count)                                                                      \
    _Static_assert(sizeof(struct name##_float) == offsetof(struct name##_float, first_word) + 4 * (word_count) &&      \
                       offsetof(struct name, first_word) == 2 * offsetof(struct name##_float, first_word) &&           \
                       sizeof(struct name) == offsetof(struct name, first_word) + 4 * (word_count),                    \
                   "struct " #name " is not reals, then words without a gap")

SHAPE_HOLDS(kiln_gpu_light_node, left, 4);
SHAPE_HOLDS(kiln_gpu_area_light, radiance, 14);
SHAPE_HOLDS(kiln_gpu_point_light, intensity, 4);
SHAPE_HOLDS(kiln_gpu_directional_light, irradiance, 4);
SHAPE_HOLDS(kiln_gpu_direct_sums, rays, 2);
static const struct shape node_shape = SHAPE(kiln_gpu_light_node, left, 4);
static const struct shape area_shape = SHAPE(kiln_gpu_area_light, radiance, 14);
static const struct shape point_shape = SHAPE(kiln_gpu_point_light, intensity, 4);
static const struct shape directional_shape = SHAPE(kiln_gpu_directional_light, irradiance, 4);
static const struct shape real_shape = {1, 0, sizeof(double), sizeof(float)};

size_t vulkan_lights_sums_bytes(bool float64)
{
    return float64 ? sizeof(struct kiln_gpu_direct_sums) : sizeof(struct kiln_gpu_direct_sums_float);
}

/* Lights that are being made. */
struct builder {
    struct gpu *gpu;
    const struct kiln_lights *model;
    struct vulkan_lights *lights;
    size_t used; /* buffers */
    bool float64;
};

/* Converts structs from double to float in place. */
static void narrow(const struct shape *shape, unsigned char *data, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const unsigned char *from = data + i * shape->size;
        unsigned char *to = data + i * shape->float_size;
        for (size_t r = 0; r < shape->reals; r++) {
            double wide;
            memcpy(&wide, from + r * sizeof wide, sizeof wide);
            const float slim = (float)wide;
            memcpy(to + r * sizeof slim, &slim, sizeof slim);
        }
        memmove(to + shape->reals * sizeof(float), from + shape->reals * sizeof(double),
                shape->words * sizeof(uint32_t));
    }
}

static int put_bytes(struct builder *b, const void *data, size_t size, const char *what, uint64_t *address,
                     struct kiln_error *error)
{
    struct gpu_buffer *buffer = &b->lights->buffers[b->used++];
    const int status = gpu_buffer_of(b->gpu, buffer, data, size, what, error);
    *address = buffer->address;
    return status;
}

static void copy3(double to[3], struct kiln_dvec3 from)
{
    to[0] = from.x;
    to[1] = from.y;
    to[2] = from.z;
}

/* ---- entry i of each array, in double ---- */

static void make_node(const struct kiln_lights *model, size_t i, void *entry)
{
    const struct kiln_light_node *n = &model->nodes[i];
    const struct kiln_light_bounds bounds = kiln_light_bounds_of(n);
    struct kiln_gpu_light_node *node = entry;
    *node = (struct kiln_gpu_light_node){.radius = bounds.radius,
                                         .floor2 = bounds.floor2,
                                         .cos_o = bounds.cos_o,
                                         .sin_o = bounds.sin_o,
                                         .cos_e = bounds.cos_e,
                                         .power = bounds.power,
                                         .left = n->left,
                                         .right = n->right,
                                         .flags = n->two_sided ? KILN_GPU_LIGHT_TWO_SIDED : 0};
    copy3(node->centre, bounds.centre);
    copy3(node->axis, n->axis);
}

static void make_area(const struct kiln_lights *model, size_t i, void *entry)
{
    const struct kiln_area_light *a = &model->areas[i];
    struct kiln_gpu_area_light *area = entry;
    *area = (struct kiln_gpu_area_light){.area = a->area,
                                         .rounding = a->rounding,
                                         .triangle = a->triangle,
                                         .flags = (a->two_sided ? KILN_GPU_LIGHT_TWO_SIDED : 0) |
                                                  (a->textured ? KILN_GPU_LIGHT_HAS_TEXTURE : 0),
                                         .path = a->path,
                                         .depth = a->depth,
                                         .turn = a->turn};
    memcpy(area->at, a->at, sizeof area->at);
    copy3(area->p0, a->p0);
    copy3(area->e1, a->e1);
    copy3(area->e2, a->e2);
    copy3(area->normal, a->normal);
    memcpy(area->radiance, a->radiance, sizeof area->radiance);
}

static void make_point(const struct kiln_lights *model, size_t i, void *entry)
{
    const struct kiln_point_light *p = &model->points[i];
    struct kiln_gpu_point_light *point = entry;
    *point = (struct kiln_gpu_point_light){.range = p->range,
                                           .cos_inner = p->cos_inner,
                                           .cos_outer = p->cos_outer,
                                           .flags = p->spot ? KILN_GPU_LIGHT_IS_SPOT : 0};
    copy3(point->position, p->position);
    copy3(point->direction, p->direction);
    memcpy(point->intensity, p->intensity, sizeof point->intensity);
}

static void make_directional(const struct kiln_lights *model, size_t i, void *entry)
{
    struct kiln_gpu_directional_light *light = entry;
    *light = (struct kiln_gpu_directional_light){.reserved = 0};
    copy3(light->towards, model->directionals[i].towards);
    memcpy(light->irradiance, model->directionals[i].irradiance, sizeof light->irradiance);
}

/* See struct kiln_gpu_lights, `rows`. */
static void make_row(const struct kiln_lights *model, size_t i, void *entry)
{
    const size_t height = model->scene->environment->height, y = i <= height ? i : i - height - 1;
    const double cosine = cos(KILN_PI * (double)y / (double)height);
    *(double *)entry = i <= height ? cosine : cosine - cos(KILN_PI * (double)(y + 1) / (double)height);
}

/* ---- onto the device ---- */

static int put_list(struct builder *b, const struct shape *shape,
                    void (*make)(const struct kiln_lights *model, size_t i, void *entry), size_t count,
                    const char *what, uint64_t *address, struct kiln_error *error)
{
    unsigned char *list = NULL;
    int status;
    KILN_TRY(kiln_allocate(&list, count, shape->size, what, error));
    for (size_t i = 0; i < count; i++)
        make(b->model, i, list + i * shape->size);
    if (!b->float64)
        narrow(shape, list, count);
    KILN_TRY(put_bytes(b, list, count * (b->float64 ? shape->size : shape->float_size), what, address, error));
end:
    kiln_free(&list);
    return status;
}

/* Stores the image times its factor, as kiln_environment_radiance computes it. */
static int put_texels(struct builder *b, uint64_t *address, struct kiln_error *error)
{
    const struct kiln_environment *e = b->model->scene->environment;
    const size_t count = (size_t)e->width * e->height;
    float *texels = NULL;
    int status;
    KILN_TRY(kiln_allocate(&texels, count, 3 * sizeof *texels, "the environment's image", error));
    for (size_t i = 0; i < 3 * count; i++)
        texels[i] = e->radiance[i % 3] * b->model->scene->environment_texels[i];
    KILN_TRY(put_bytes(b, texels, 3 * count * sizeof *texels, "the environment's image", address, error));
end:
    kiln_free(&texels);
    return status;
}

static int put_image(struct builder *b, struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    const struct kiln_environment *e = b->model->scene->environment;
    const size_t texels = (size_t)e->width * e->height;
    layout->width = e->width;
    layout->height = e->height;
    layout->rotation = e->rotation;
    int status =
        put_bytes(b, b->model->marginal, e->height * sizeof(float), "the environment's rows", &layout->marginal, error);
    KILN_TRY(status);
    KILN_TRY(put_bytes(b, b->model->conditional, texels * sizeof(float), "the environment's distribution",
                       &layout->conditional, error));
    KILN_TRY(
        put_list(b, &real_shape, make_row, 2 * (size_t)e->height + 1, "the environment's rows", &layout->rows, error));
    KILN_TRY(put_texels(b, &layout->texels, error));
end:
    return status;
}

static int put_environment(struct builder *b, struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    if (!b->model->environment)
        return KILN_OK;
    layout->environment = 1;
    memcpy(layout->mean, b->model->environment_mean, sizeof layout->mean);
    if (b->model->conditional != NULL)
        return put_image(b, layout, error);
    memcpy(layout->sky, b->model->scene->environment->radiance, sizeof layout->sky);
    return KILN_OK;
}

static uint32_t kinds_of(const struct kiln_lights *model)
{
    uint32_t kinds = (model->area_count != 0 ? KILN_GPU_KIND_AREA : 0) |
                     (model->point_count != 0 ? KILN_GPU_KIND_PUNCTUAL : 0) |
                     (model->directional_count != 0 ? KILN_GPU_KIND_SUN : 0);
    for (size_t i = 0; i < model->area_count; i++)
        kinds |= model->areas[i].textured ? KILN_GPU_KIND_TEXTURED : 0;
    if (model->environment)
        kinds |= model->conditional != NULL ? KILN_GPU_KIND_IMAGE : KILN_GPU_KIND_SKY;
    return kinds;
}

int vulkan_lights_create(struct gpu *gpu, const struct kiln_lights *model, bool float64, struct vulkan_lights *lights,
                         struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    struct builder b = {.gpu = gpu, .model = model, .lights = lights, .float64 = float64};
    memset(lights, 0, sizeof *lights);
    memset(layout, 0, sizeof *layout);
    lights->kinds = kinds_of(model);
    layout->area_count = (uint32_t)model->area_count;
    layout->directional_count = (uint32_t)model->directional_count;
    int status;
    KILN_TRY(put_list(&b, &node_shape, make_node, model->node_count, "the light tree", &layout->nodes, error));
    KILN_TRY(put_list(&b, &area_shape, make_area, model->area_count, "the emissive triangles", &layout->areas, error));
    KILN_TRY(put_list(&b, &point_shape, make_point, model->point_count, "the point lights", &layout->points, error));
    KILN_TRY(put_list(&b, &directional_shape, make_directional, model->directional_count, "the directional lights",
                      &layout->directionals, error));
    KILN_TRY(put_environment(&b, layout, error));
end:
    if (status != KILN_OK)
        vulkan_lights_destroy(gpu, lights);
    return status;
}

void vulkan_lights_destroy(struct gpu *gpu, struct vulkan_lights *lights)
{
    for (size_t i = 0; i < VULKAN_LIGHT_BUFFERS; i++)
        gpu_buffer_destroy(gpu, &lights->buffers[i]);
    lights->kinds = 0;
}
