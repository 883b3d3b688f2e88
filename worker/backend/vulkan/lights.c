#include "worker/backend/vulkan/lights.h"

#include <string.h>

#include "worker/base/memory.h"

#define KILN_LIGHT_REAL double
#define KILN_LIGHT_NAME(name) name
#include "shaders/layout_light_real.h"
#undef KILN_LIGHT_REAL
#undef KILN_LIGHT_NAME
#define KILN_LIGHT_REAL float
#define KILN_LIGHT_NAME(name) name##_float
#include "shaders/layout_light_real.h"

/* How many reals a struct begins with, and how many words follow. */
struct shape {
    size_t reals, words, size, float_size;
};
#define SHAPE(name, first_word, word_count) \
    {offsetof(struct name, first_word) / sizeof(double), word_count, sizeof(struct name), sizeof(struct name##_float)}
#define SHAPE_HOLDS(name, first_word, word_count)                                                                                     \
    _Static_assert(sizeof(struct name##_float) == offsetof(struct name##_float, first_word) + 4 * (word_count) &&                     \
                       offsetof(struct name, first_word) == 2 * offsetof(struct name##_float, first_word) &&                          \
                       sizeof(struct name) == offsetof(struct name, first_word) + 4 * (word_count),                                   \
                   "struct " #name " is not reals, then words without a gap")

SHAPE_HOLDS(kiln_gpu_light_node, left, 4);
SHAPE_HOLDS(kiln_gpu_area_light, radiance, 6);
SHAPE_HOLDS(kiln_gpu_point_light, intensity, 4);
SHAPE_HOLDS(kiln_gpu_directional_light, irradiance, 4);
SHAPE_HOLDS(kiln_gpu_direct_sums, rays, 2);
static const struct shape node_shape = SHAPE(kiln_gpu_light_node, left, 4);
static const struct shape area_shape = SHAPE(kiln_gpu_area_light, radiance, 6);
static const struct shape point_shape = SHAPE(kiln_gpu_point_light, intensity, 4);
static const struct shape directional_shape = SHAPE(kiln_gpu_directional_light, irradiance, 4);
static const struct shape real_shape = {1, 0, sizeof(double), sizeof(float)};

size_t vulkan_lights_sums_bytes(bool float64)
{
    return float64 ? sizeof(struct kiln_gpu_direct_sums) : sizeof(struct kiln_gpu_direct_sums_float);
}

/* What is being made. */
struct builder {
    struct gpu *gpu;
    const struct kiln_lights *model;
    struct vulkan_lights *lights;
    size_t used; /* buffers */
    bool float64;
};

/* The structs in float, in the place where they stood in double. */
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
        memmove(to + shape->reals * sizeof(float), from + shape->reals * sizeof(double), shape->words * sizeof(uint32_t));
    }
}

static int put_bytes(struct builder *b, const void *data, size_t size, const char *what, uint64_t *address, struct kiln_error *error)
{
    struct gpu_buffer *buffer = &b->lights->buffers[b->used++];
    const int status = gpu_buffer_of(b->gpu, buffer, data, size, what, error);
    *address = buffer->address;
    return status;
}

static int put(struct builder *b, const struct shape *shape, void *data, size_t count, const char *what, uint64_t *address,
               struct kiln_error *error)
{
    if (!b->float64)
        narrow(shape, data, count);
    return put_bytes(b, data, count * (b->float64 ? shape->size : shape->float_size), what, address, error);
}

static void copy3(double to[3], struct kiln_dvec3 from)
{
    to[0] = from.x;
    to[1] = from.y;
    to[2] = from.z;
}

static struct kiln_gpu_light_node node_of(const struct kiln_light_node *n)
{
    const struct kiln_dvec3 half = dvec3_scale(dvec3_sub(n->maximum, n->minimum), 0.5);
    struct kiln_gpu_light_node node = {.radius = dvec3_length(half),
                                       .floor2 = 0.25 * dvec3_dot(half, half),
                                       .cos_o = n->cos_o,
                                       .sin_o = sqrt(fmax(0.0, 1.0 - n->cos_o * n->cos_o)),
                                       .cos_e = n->cos_e,
                                       .power = n->power,
                                       .left = n->left,
                                       .right = n->right,
                                       .flags = n->two_sided ? KILN_LIGHT_TWO_SIDED : 0};
    copy3(node.centre, dvec3_scale(dvec3_add(n->minimum, n->maximum), 0.5));
    copy3(node.axis, n->axis);
    return node;
}

static int put_nodes(struct builder *b, struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    const size_t count = b->model->node_count;
    struct kiln_gpu_light_node *nodes = NULL;
    int status = kiln_allocate(&nodes, count, sizeof *nodes, "the light tree", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        nodes[i] = node_of(&b->model->nodes[i]);
    if (status == KILN_OK)
        status = put(b, &node_shape, nodes, count, "the light tree", &layout->nodes, error);
    layout->node_count = (uint32_t)count;
    kiln_free(&nodes);
    return status;
}

static struct kiln_gpu_area_light area_of(const struct kiln_area_light *a)
{
    struct kiln_gpu_area_light area = {.area = a->area,
                                       .rounding = a->rounding,
                                       .triangle = a->triangle,
                                       .flags = (a->two_sided ? KILN_LIGHT_TWO_SIDED : 0) | (a->textured ? KILN_LIGHT_HAS_TEXTURE : 0)};
    copy3(area.p0, a->p0);
    copy3(area.e1, a->e1);
    copy3(area.e2, a->e2);
    copy3(area.normal, a->normal);
    memcpy(area.radiance, a->radiance, sizeof area.radiance);
    return area;
}

static int put_areas(struct builder *b, struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    const size_t count = b->model->area_count;
    struct kiln_gpu_area_light *areas = NULL;
    int status = kiln_allocate(&areas, count, sizeof *areas, "the emissive triangles", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        areas[i] = area_of(&b->model->areas[i]);
        b->lights->kinds |= KILN_LIGHT_AREA | (b->model->areas[i].textured ? KILN_LIGHT_TEXTURED : 0);
    }
    if (status == KILN_OK)
        status = put(b, &area_shape, areas, count, "the emissive triangles", &layout->areas, error);
    layout->area_count = (uint32_t)count;
    kiln_free(&areas);
    return status;
}

static struct kiln_gpu_point_light point_of(const struct kiln_point_light *p)
{
    struct kiln_gpu_point_light point = {.range = p->range, .cos_inner = p->cos_inner, .cos_outer = p->cos_outer, .flags = p->spot ? KILN_LIGHT_IS_SPOT : 0};
    copy3(point.position, p->position);
    copy3(point.direction, p->direction);
    memcpy(point.intensity, p->intensity, sizeof point.intensity);
    return point;
}

static int put_points(struct builder *b, struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    const size_t count = b->model->point_count;
    struct kiln_gpu_point_light *points = NULL;
    int status = kiln_allocate(&points, count, sizeof *points, "the point lights", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        points[i] = point_of(&b->model->points[i]);
    if (status == KILN_OK)
        status = put(b, &point_shape, points, count, "the point lights", &layout->points, error);
    b->lights->kinds |= count != 0 ? KILN_LIGHT_PUNCTUAL : 0;
    layout->point_count = (uint32_t)count;
    kiln_free(&points);
    return status;
}

static int put_directionals(struct builder *b, struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    const size_t count = b->model->directional_count;
    struct kiln_gpu_directional_light *lights = NULL;
    int status = kiln_allocate(&lights, count, sizeof *lights, "the directional lights", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        copy3(lights[i].towards, b->model->directionals[i].towards);
        memcpy(lights[i].irradiance, b->model->directionals[i].irradiance, sizeof lights[i].irradiance);
    }
    if (status == KILN_OK)
        status = put(b, &directional_shape, lights, count, "the directional lights", &layout->directionals, error);
    b->lights->kinds |= count != 0 ? KILN_LIGHT_SUN : 0;
    layout->directional_count = (uint32_t)count;
    kiln_free(&lights);
    return status;
}

static int put_cosines(struct builder *b, uint32_t height, uint64_t *address, struct kiln_error *error)
{
    double *cosines = NULL;
    int status = kiln_allocate(&cosines, (size_t)height + 1, sizeof *cosines, "the environment's rows", error);
    for (uint32_t y = 0; status == KILN_OK && y <= height; y++)
        cosines[y] = cos(KILN_PI * y / height);
    if (status == KILN_OK)
        status = put(b, &real_shape, cosines, (size_t)height + 1, "the environment's rows", address, error);
    kiln_free(&cosines);
    return status;
}

/* The image times its factor, as kiln_environment_radiance multiplies it. */
static int put_texels(struct builder *b, uint64_t *address, struct kiln_error *error)
{
    const struct kiln_environment *e = b->model->scene->environment;
    const size_t count = (size_t)e->width * e->height;
    float *texels = NULL;
    int status = kiln_allocate(&texels, count, 3 * sizeof *texels, "the environment's image", error);
    for (size_t i = 0; status == KILN_OK && i < 3 * count; i++)
        texels[i] = e->radiance[i % 3] * b->model->scene->environment_texels[i];
    if (status == KILN_OK)
        status = put_bytes(b, texels, 3 * count * sizeof *texels, "the environment's image", address, error);
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
    b->lights->kinds |= KILN_LIGHT_IMAGE;
    int status = put_bytes(b, b->model->marginal, e->height * sizeof(float), "the environment's rows", &layout->marginal, error);
    if (status == KILN_OK)
        status = put_bytes(b, b->model->conditional, texels * sizeof(float), "the environment's distribution", &layout->conditional, error);
    if (status == KILN_OK)
        status = put_cosines(b, e->height, &layout->cosines, error);
    if (status == KILN_OK)
        status = put_texels(b, &layout->texels, error);
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
    b->lights->kinds |= KILN_LIGHT_SKY;
    memcpy(layout->sky, b->model->scene->environment->radiance, sizeof layout->sky);
    return KILN_OK;
}

int vulkan_lights_create(struct gpu *gpu, const struct kiln_lights *model, bool float64, struct vulkan_lights *lights,
                         struct kiln_gpu_lights *layout, struct kiln_error *error)
{
    struct builder b = {.gpu = gpu, .model = model, .lights = lights, .float64 = float64};
    memset(lights, 0, sizeof *lights);
    memset(layout, 0, sizeof *layout);
    int status = put_nodes(&b, layout, error);
    if (status == KILN_OK)
        status = put_areas(&b, layout, error);
    if (status == KILN_OK)
        status = put_points(&b, layout, error);
    if (status == KILN_OK)
        status = put_directionals(&b, layout, error);
    if (status == KILN_OK)
        status = put_environment(&b, layout, error);
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
