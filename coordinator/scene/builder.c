#include "coordinator/scene/builder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "worker/base/calls.h"
#include "worker/base/memory.h"

/* Beyond this many transformed vertices, the bounds are computed from the corners of each mesh's bounding box: an upper
 * bound, in bounded time. */
static const uint64_t exact_bounds_vertices = 1u << 24;

enum { SECTION_ALIGNMENT = 64, NOTE_LENGTH = 1024 };

int kiln_builder_create(struct kiln_builder **builder, struct kiln_error *error)
{
    *builder = NULL;
    return kiln_allocate(builder, 1, sizeof **builder, "the scene", error);
}

void kiln_builder_destroy(struct kiln_builder **pointer)
{
    struct kiln_builder *builder = *pointer;
    if (builder == NULL)
        return;
    for (unsigned s = 0; s < KILN_SECTION_COUNT; s++)
        kiln_free(&builder->sections[s].data);
    kiln_free(&builder->mesh_has_lightmap_uv);
    kiln_free(&builder->object_settings);
    kiln_free(&builder->mesh_turned);
    kiln_free(pointer);
}

int kiln_builder_append(struct kiln_builder *builder, enum kiln_scene_section section, const void *data, size_t count,
                        size_t *first, struct kiln_error *error)
{
    const size_t size = kiln_scene_element_size(section);
    const size_t old = builder->sections[section].count;
    if (count > SIZE_MAX / 2 - old)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu more elements for the scene's %s", count,
                         kiln_scene_section_name(section));
    int status = kiln_grow(&builder->sections[section].data, &builder->sections[section].capacity, old + count, size,
                           kiln_scene_section_name(section), error);
    if (status != KILN_OK)
        return status;
    if (section == KILN_SECTION_MESHES) {
        status = kiln_grow(&builder->mesh_has_lightmap_uv, &builder->mesh_capacity, old + count, 1, "meshes", error);
        if (status != KILN_OK)
            return status;
        memset(builder->mesh_has_lightmap_uv + old, 0, count);
        status = kiln_grow(&builder->mesh_turned, &builder->turned_capacity, old + count, sizeof *builder->mesh_turned,
                           "meshes", error);
        if (status != KILN_OK)
            return status;
        memset(builder->mesh_turned + old, 0, count * sizeof *builder->mesh_turned);
    }
    if (section == KILN_SECTION_OBJECTS) {
        status = kiln_grow(&builder->object_settings, &builder->object_capacity, old + count,
                           sizeof *builder->object_settings, "objects", error);
        if (status != KILN_OK)
            return status;
        for (size_t i = 0; i < count; i++)
            builder->object_settings[old + i] = (struct kiln_object_settings){0};
    }
    if (count > 0) {
        unsigned char *target = (unsigned char *)builder->sections[section].data + old * size;
        if (data != NULL)
            memcpy(target, data, count * size);
        else
            memset(target, 0, count * size);
    }
    builder->sections[section].count = old + count;
    if (first != NULL)
        *first = old;
    return KILN_OK;
}

int kiln_builder_reserve(struct kiln_builder *builder, enum kiln_scene_section section, size_t count,
                         struct kiln_error *error)
{
    const size_t size = kiln_scene_element_size(section);
    if (builder->sections[section].count > 0 || count <= builder->sections[section].capacity)
        return KILN_OK;
    kiln_free(&builder->sections[section].data);
    builder->sections[section].capacity = 0;
    const int status = kiln_allocate(&builder->sections[section].data, count, size, "the scene", error);
    builder->sections[section].capacity = status == KILN_OK ? count : 0;
    return status;
}

bool kiln_builder_has(const struct kiln_builder *builder, enum kiln_scene_section section)
{
    return (section != KILN_SECTION_TEXCOORD_NORMAL || builder->sections[KILN_SECTION_NORMAL_MAPS].count > 0) &&
           (section != KILN_SECTION_TEXCOORD_GLOSS || builder->sections[KILN_SECTION_GLOSS].count > 0);
}

int kiln_builder_string(struct kiln_builder *builder, const char *text, size_t length, uint32_t *offset,
                        struct kiln_error *error)
{
    length = strnlen(text, length);
    if (builder->sections[KILN_SECTION_STRINGS].count + length >= UINT32_MAX)
        return kiln_fail(error, KILN_BAD_INPUT, "the names in the scene take more than 4 GiB: shorten them");
    size_t first = 0;
    int status;
    KILN_TRY(kiln_builder_append(builder, KILN_SECTION_STRINGS, text, length, &first, error));
    KILN_TRY(kiln_builder_append(builder, KILN_SECTION_STRINGS, "", 1, NULL, error));
    *offset = (uint32_t)first;
end:
    return status;
}

int kiln_builder_note(struct kiln_builder *builder, uint32_t severity, struct kiln_error *error, const char *format,
                      ...)
{
    char text[NOTE_LENGTH];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    struct kiln_note note = {.severity = severity};
    const int status = kiln_builder_string(builder, text, sizeof text, &note.text, error);
    if (status != KILN_OK)
        return status;
    return kiln_builder_append(builder, KILN_SECTION_NOTES, &note, 1, NULL, error);
}

int kiln_builder_make_part(struct kiln_builder *builder, struct kiln_error *error)
{
    struct kiln_mesh *meshes = KILN_BUILDER_DATA(builder, struct kiln_mesh, KILN_SECTION_MESHES);
    struct kiln_object *objects = KILN_BUILDER_DATA(builder, struct kiln_object, KILN_SECTION_OBJECTS);
    const size_t count = builder->sections[KILN_SECTION_OBJECTS].count;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_MESHES].count; i++)
        meshes[i].flags |=
            (builder->mesh_has_lightmap_uv[i] != KILN_LIGHTMAP_UV_NONE ? KILN_MESH_HAS_SECOND_UV : 0u) |
            (builder->mesh_has_lightmap_uv[i] == KILN_LIGHTMAP_UV_SOUND ? KILN_MESH_SOUND_SECOND_UV : 0u);
    for (size_t i = 0; i < count; i++)
        objects[i].lightmap_width = objects[i].lightmap_height = 1;
    builder->part = true;
    return kiln_builder_append(builder, KILN_SECTION_OBJECT_SETTINGS, builder->object_settings, count, NULL, error);
}

struct bounds {
    struct kiln_dvec3 low, high;
};

static void bounds_add(struct bounds *bounds, const double transform[12], struct kiln_vec3 p)
{
    double world[3];
    for (int r = 0; r < 3; r++)
        world[r] = transform[4 * r] * (double)p.x + transform[4 * r + 1] * (double)p.y +
                   transform[4 * r + 2] * (double)p.z + transform[4 * r + 3];
    bounds->low = dvec3(fmin(bounds->low.x, world[0]), fmin(bounds->low.y, world[1]), fmin(bounds->low.z, world[2]));
    bounds->high =
        dvec3(fmax(bounds->high.x, world[0]), fmax(bounds->high.y, world[1]), fmax(bounds->high.z, world[2]));
}

static bool in_range(const struct bounds *b)
{
    const double limit = (double)KILN_COORDINATE_MAX;
    return b->low.x >= -limit && b->low.y >= -limit && b->low.z >= -limit && b->high.x <= limit && b->high.y <= limit &&
           b->high.z <= limit;
}

/* The eight corners of a mesh's bounding box. */
static void mesh_corners(const struct kiln_vec3 *positions, uint64_t count, struct kiln_vec3 corner[8])
{
    struct kiln_vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint64_t v = 0; v < count; v++) {
        low = vec3(fminf(low.x, positions[v].x), fminf(low.y, positions[v].y), fminf(low.z, positions[v].z));
        high = vec3(fmaxf(high.x, positions[v].x), fmaxf(high.y, positions[v].y), fmaxf(high.z, positions[v].z));
    }
    for (unsigned c = 0; c < 8; c++)
        corner[c] = vec3(c & 1 ? high.x : low.x, c & 2 ? high.y : low.y, c & 4 ? high.z : low.z);
}

/* The origin of traced coordinates: the mean of the objects' centres, each with weight 1 / size². Floats are precise
 * near the origin and coarse far from it, so the origin belongs where detail is: receivers at 1e-6 m and at 1e6 m from
 * one lamp then both have seven digits of their own distance. For objects of similar size it is the centre. */
struct origin {
    struct kiln_dvec3 sum;
    double weight;
};

static void origin_add(struct origin *origin, const struct bounds *object)
{
    const struct kiln_dvec3 size = dvec3_sub(object->high, object->low);
    const double extent = fmax(size.x, fmax(size.y, size.z));
    if (!(extent > 0.0) || !isfinite(extent))
        return;
    const double weight = 1.0 / (extent * extent);
    origin->sum = dvec3_add(origin->sum, dvec3_scale(dvec3_add(object->low, object->high), 0.5 * weight));
    origin->weight += weight;
}

static const struct bounds no_bounds = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static int world_bounds(const struct kiln_builder *builder, struct kiln_scene_header *header, struct kiln_error *error)
{
    const struct kiln_mesh *meshes = KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES);
    const struct kiln_object *objects = KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS);
    const struct kiln_vec3 *positions = KILN_BUILDER_DATA(builder, const struct kiln_vec3, KILN_SECTION_POSITIONS);
    const size_t mesh_count = builder->sections[KILN_SECTION_MESHES].count;
    const size_t object_count = builder->sections[KILN_SECTION_OBJECTS].count;
    struct bounds bounds = no_bounds;
    struct origin origin = {{0.0, 0.0, 0.0}, 0.0};
    int status = KILN_OK;
    uint64_t work = 0;
    for (size_t i = 0; i < object_count; i++)
        work += meshes[objects[i].mesh].vertex_count;
    struct kiln_vec3(*corners)[8] = NULL;
    if (work > exact_bounds_vertices) {
        status = kiln_allocate(&corners, mesh_count, sizeof *corners, "the boxes of meshes", error);
        if (status != KILN_OK)
            return status;
        for (size_t m = 0; m < mesh_count; m++)
            mesh_corners(positions + meshes[m].vertex_first, meshes[m].vertex_count, corners[m]);
    }
    for (size_t i = 0; i < object_count; i++) {
        const struct kiln_mesh *mesh = &meshes[objects[i].mesh];
        struct bounds own = no_bounds;
        if (corners != NULL)
            for (unsigned c = 0; mesh->vertex_count > 0 && c < 8; c++)
                bounds_add(&own, objects[i].transform, corners[objects[i].mesh][c]);
        else
            for (uint64_t v = 0; v < mesh->vertex_count; v++)
                bounds_add(&own, objects[i].transform, positions[mesh->vertex_first + v]);
        bounds.low = dvec3(fmin(bounds.low.x, own.low.x), fmin(bounds.low.y, own.low.y), fmin(bounds.low.z, own.low.z));
        bounds.high =
            dvec3(fmax(bounds.high.x, own.high.x), fmax(bounds.high.y, own.high.y), fmax(bounds.high.z, own.high.z));
        if (mesh->vertex_count > 0)
            origin_add(&origin, &own);
        if (mesh->vertex_count > 0 && !in_range(&bounds)) {
            status = kiln_fail(error, KILN_BAD_INPUT, "object '%s' reaches beyond +-%g m; scale or move the scene",
                               KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS) + objects[i].original_name,
                               (double)KILN_COORDINATE_MAX);
            break;
        }
    }
    kiln_free(&corners);
    if (status != KILN_OK)
        return status;
    if (!(bounds.low.x <= bounds.high.x)) /* no object has a vertex */
        bounds.low = bounds.high = dvec3(0.0, 0.0, 0.0);
    memcpy(header->bounds_min, &bounds.low, sizeof bounds.low);
    memcpy(header->bounds_max, &bounds.high, sizeof bounds.high);
    const struct kiln_dvec3 centre = origin.weight > 0.0 && isfinite(origin.weight)
                                         ? dvec3_scale(origin.sum, 1.0 / origin.weight)
                                         : dvec3_scale(dvec3_add(bounds.low, bounds.high), 0.5);
    memcpy(header->centre, &centre, sizeof centre);
    return KILN_OK;
}

static uint64_t aligned(uint64_t offset)
{
    return (offset + SECTION_ALIGNMENT - 1) / SECTION_ALIGNMENT * SECTION_ALIGNMENT;
}

static int fill_header(const struct kiln_builder *builder, struct kiln_scene_header *header, struct kiln_error *error)
{
    memset(header, 0, sizeof *header);
    header->magic = KILN_SCENE_MAGIC;
    header->version = builder->part                                           ? KILN_SCENE_VERSION_PART
                      : builder->sections[KILN_SECTION_GLOSS].count > 0       ? KILN_SCENE_VERSION
                      : builder->sections[KILN_SECTION_NORMAL_MAPS].count > 0 ? KILN_SCENE_VERSION_NORMAL_MAPS
                                                                              : KILN_SCENE_VERSION_PLAIN;
    memcpy(header->import_hash, builder->import_hash, sizeof header->import_hash);
    header->texels_per_metre = builder->texels_per_metre;
    header->padding_factor = builder->padding_factor;
    header->units = builder->units;
    uint64_t offset = kiln_scene_header_bytes(header->version);
    for (unsigned s = 0; s < kiln_scene_sections(header->version); s++) {
        offset = aligned(offset);
        header->sections[s].offset = offset;
        header->sections[s].count = builder->sections[s].count;
        offset += builder->sections[s].count * kiln_scene_element_size((enum kiln_scene_section)s);
    }
    header->size = aligned(offset);
    return world_bounds(builder, header, error);
}

static int write_all(int file, const void *data, size_t size, uint64_t offset)
{
    const unsigned char *bytes = data;
    for (size_t at = 0; at < size;) {
        const ssize_t count = pwrite(file, bytes + at, size - at, (off_t)(offset + at));
        if (count < 0 && errno != EINTR)
            return -1;
        at += count > 0 ? (size_t)count : 0;
    }
    return 0;
}

/* Writes each section and frees its memory. */
static int write_sections(struct kiln_builder *builder, int file, const struct kiln_scene_header *header)
{
    for (unsigned s = 0; s < kiln_scene_sections(header->version); s++) {
        const size_t size = builder->sections[s].count * kiln_scene_element_size((enum kiln_scene_section)s);
        if (write_all(file, builder->sections[s].data, size, header->sections[s].offset) != 0)
            return -1;
        kiln_free(&builder->sections[s].data);
        builder->sections[s].count = builder->sections[s].capacity = 0;
    }
    return 0;
}

/* Hashes what the file really contains. */
static int hash_file(int file, const char *path, struct kiln_scene_header *header, struct kiln_error *error)
{
    void *map = mmap(NULL, (size_t)header->size, PROT_READ, MAP_SHARED, file, 0);
    if (map == MAP_FAILED)
        return kiln_fail_errno(error, KILN_SYSTEM, "%s: the scene file of %llu bytes cannot be mapped", path,
                               (unsigned long long)header->size);
    kiln_scene_content_hash(header, (const unsigned char *)map + kiln_scene_header_bytes(header->version),
                            header->content_hash);
    (void)munmap(map, (size_t)header->size);
    return KILN_OK;
}

int kiln_builder_write_to(struct kiln_builder *builder, int file, const char *name, struct kiln_error *error)
{
    struct kiln_scene_header header;
    int status;
    KILN_TRY(fill_header(builder, &header, error));
    /* Disk space is reserved first: a full disk is noticed before anything is written. */
    errno = kiln_fallocate(file, (off_t)header.size);
    if (errno != 0)
        return kiln_fail_errno(error, KILN_IO, "%s: no disk space for a scene file of %llu bytes", name,
                               (unsigned long long)header.size);
    if (write_sections(builder, file, &header) != 0)
        return kiln_fail_errno(error, KILN_IO, "%s: the scene file cannot be written", name);
    KILN_TRY(hash_file(file, name, &header, error));
    if (write_all(file, &header, kiln_scene_header_bytes(header.version), 0) != 0 || kiln_fsync(file) != 0)
        KILN_TRY(kiln_fail_errno(error, KILN_IO, "%s: the scene file cannot be written", name));
end:
    return status;
}

int kiln_builder_write(struct kiln_builder *builder, const char *path, struct kiln_error *error)
{
    const int file = kiln_open(path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (file < 0)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "%s: the scene file cannot be created", path);
    int status = kiln_builder_write_to(builder, file, path, error);
    if (kiln_close(file) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "%s: the scene file cannot be closed", path);
    if (status != KILN_OK)
        (void)unlink(path);
    return status;
}
