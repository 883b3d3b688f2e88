#include "coordinator/export/pages.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/export/atlas.h"
#include "coordinator/output/exr.h"
#include "coordinator/output/map.h"
#include "coordinator/output/publish.h"
#include "worker/base/memory.h"

/* "lightmaps/NAME.exr", kept by the pages. NULL without memory. */
static const char *keep_name(struct kiln_pages *pages, const char *name, const char *ending, struct kiln_error *error)
{
    const size_t room = strlen(name) + strlen(ending) + sizeof "lightmaps/";
    char **kept = &pages->names[pages->name_count];
    if (kiln_allocate(kept, room, 1, "the pages' names", error) != KILN_OK)
        return NULL;
    (void)snprintf(*kept, room, "lightmaps/%s%s", name, ending);
    pages->name_count++;
    return *kept;
}

/* The channels `wanted` of an object's lightmap, which has the size that the scene says. */
static int read_lightmap(const struct kiln_pages_params *p, size_t object, const char *const *wanted, size_t count, struct kiln_image **image,
                         struct kiln_error *error)
{
    char name[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    const struct kiln_object *o = &p->scene->objects[object];
    (void)snprintf(name, sizeof name, "lightmaps/%s.exr", kiln_scene_string(p->scene, o->name));
    int status = kiln_path_join(path, p->directory, name, error);
    if (status == KILN_OK)
        status = kiln_exr_read(path, wanted, count, image, error);
    if (status == KILN_OK && ((*image)->width != o->lightmap_width || (*image)->height != o->lightmap_height))
        status = kiln_fail(error, KILN_BAD_INPUT, "%.512s has %u x %u texels where the scene says %u x %u; bake again", path, (*image)->width,
                           (*image)->height, o->lightmap_width, o->lightmap_height);
    return status;
}

static int write_own_page(const struct kiln_pages_params *p, size_t object, struct kiln_pages *pages, struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    const struct kiln_object *o = &p->scene->objects[object];
    char path[KILN_PATH_SIZE];
    struct kiln_image *image = NULL;
    struct kiln_page_info *page = &pages->pages[pages->page_count];
    *page = (struct kiln_page_info){.width = o->lightmap_width, .height = o->lightmap_height, .range = p->range};
    page->file = keep_name(pages, kiln_scene_string(p->scene, o->name), kiln_page_ending(p->format), error);
    int status = page->file == NULL ? KILN_SYSTEM : kiln_path_join(path, p->folder, page->file, error);
    if (status == KILN_OK)
        status = read_lightmap(p, object, wanted, 3, &image, error);
    if (status == KILN_OK)
        status = kiln_page_write(path, p->format, image, &page->range, error);
    if (status == KILN_OK)
        pages->links[object] = (struct kiln_link){.file = page->file, .page = (uint32_t)pages->page_count++, .scale = {1.0, 1.0}};
    kiln_image_destroy(&image);
    return status;
}

static int write_own_pages(const struct kiln_pages_params *p, struct kiln_pages *pages, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < p->scene->object_count && status == KILN_OK; i++)
        if (kiln_export_is_published(p->scene, i))
            status = write_own_page(p, i, pages, error);
    return status;
}

/* ---- atlas ---- */

/* The outline of what the object's layout covers. */
static int outline_object(const struct kiln_pages_params *p, size_t object, struct kiln_outline *outline, struct kiln_error *error)
{
    static const char *const wanted[] = {"coverage.Y", "validity.Y"};
    const struct kiln_object *o = &p->scene->objects[object];
    const size_t count = (size_t)o->lightmap_width * o->lightmap_height;
    struct kiln_image *image = NULL;
    uint8_t *covered = NULL;
    int status = read_lightmap(p, object, wanted, 2, &image, error);
    if (status == KILN_OK)
        status = kiln_allocate(&covered, count, 1, "covered texels", error);
    const struct kiln_image_channel *coverage = status == KILN_OK ? kiln_image_find(image, "coverage.Y") : NULL;
    const struct kiln_image_channel *validity = status == KILN_OK ? kiln_image_find(image, "validity.Y") : NULL;
    if (status == KILN_OK && (coverage == NULL || validity == NULL))
        status = kiln_fail(error, KILN_BAD_INPUT, "%.512s: the lightmap of '%s' has no coverage and validity; bake again", p->directory,
                           kiln_scene_string(p->scene, o->name));
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        covered[i] = coverage->values[i] > 0.0f || validity->values[i] > 0.25f; /* coverage is a half: the least may have become 0 */
    if (status == KILN_OK)
        status = kiln_outline_make(outline, covered, o->lightmap_width, o->lightmap_height, error);
    if (status == KILN_OK && (outline->width > p->atlas || outline->height > p->atlas))
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "object '%s' keeps %u x %u texels of its lightmap, more than a page of %u x %u holds; give a larger --atlas, or bake it with "
                           "--lightmap-max %u",
                           kiln_scene_string(p->scene, o->name), outline->width, outline->height, p->atlas, p->atlas, p->atlas - 2);
    kiln_free(&covered);
    kiln_image_destroy(&image);
    return status;
}

/* Copies an object's texels; beyond its lightmap's edge those at the edge. */
static void copy_texels(struct kiln_image *page, uint8_t *state, float *const to[3], const struct kiln_outline *o, const struct kiln_image *image,
                        float *const from[3])
{
    for (size_t i = 0; i < o->run_count; i++) {
        const struct kiln_outline_run *run = &o->runs[i];
        const int64_t v = (int64_t)o->top + run->row, y = v < 0 ? 0 : v >= image->height ? (int64_t)image->height - 1 : v;
        for (uint32_t k = run->first; k < run->end; k++) {
            const int64_t u = (int64_t)o->left + k, x = u < 0 ? 0 : u >= image->width ? (int64_t)image->width - 1 : u;
            const size_t target = (size_t)(o->y + run->row) * page->width + o->x + k, source = (size_t)y * image->width + (size_t)x;
            for (int c = 0; c < 3; c++)
                to[c][target] = from[c][source];
            state[target] = 1;
        }
    }
}

/* What no object keeps takes the values of the nearest texel that one does. */
static int fill_page(const struct kiln_image *page, const uint8_t *state, float *const planes[3], struct kiln_error *error)
{
    const size_t count = (size_t)page->width * page->height;
    uint32_t *nearest = NULL;
    int status = kiln_allocate(&nearest, count, sizeof *nearest, "nearest texels", error);
    if (status == KILN_OK)
        status = kiln_nearest_texels(state, 1, page->width, page->height, nearest, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        for (int c = 0; nearest[i] != KILN_NONE && c < 3; c++)
            planes[c][i] = planes[c][nearest[i]];
    kiln_free(&nearest);
    return status;
}

/* As large as what lies on it asks for; multiples of 4, for block compression. */
static void size_page(const struct kiln_pages_params *p, const struct kiln_outline *outlines, uint32_t index, struct kiln_page_info *page)
{
    *page = (struct kiln_page_info){.range = p->range};
    for (size_t i = 0; i < p->scene->object_count; i++) {
        const struct kiln_outline *o = &outlines[i];
        if (o->run_count == 0 || o->page != index)
            continue;
        page->width = o->x + o->width > page->width ? o->x + o->width : page->width;
        page->height = o->y + o->height > page->height ? o->y + o->height : page->height;
    }
    page->width = (page->width + 3) / 4 * 4 < p->atlas ? (page->width + 3) / 4 * 4 : p->atlas;
    page->height = (page->height + 3) / 4 * 4 < p->atlas ? (page->height + 3) / 4 * 4 : p->atlas;
}

static int draw_page(const struct kiln_pages_params *p, const struct kiln_outline *outlines, uint32_t index, const struct kiln_page_info *info,
                     struct kiln_image **page, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    float *to[3], *from[3];
    uint8_t *state = NULL;
    int status = kiln_image_create(page, info->width, info->height, names, 3, error);
    if (status == KILN_OK)
        status = kiln_allocate(&state, (size_t)info->width * info->height, 1, "a page", error);
    if (status == KILN_OK)
        (void)kiln_image_rgb(*page, "", to);
    for (size_t i = 0; i < p->scene->object_count && status == KILN_OK; i++) {
        struct kiln_image *image = NULL;
        if (outlines[i].run_count == 0 || outlines[i].page != index)
            continue;
        status = read_lightmap(p, i, names, 3, &image, error);
        if (status == KILN_OK && !kiln_image_rgb(image, "", from))
            status = kiln_fail(error, KILN_BAD_INPUT, "%.512s: a lightmap has no channels R, G and B; bake again", p->directory);
        if (status == KILN_OK)
            copy_texels(*page, state, to, &outlines[i], image, from);
        kiln_image_destroy(&image);
    }
    if (status == KILN_OK)
        status = fill_page(*page, state, to, error);
    kiln_free(&state);
    return status;
}

/* page uv = TEXCOORD x scale + offset: the object's texels lie on the page's. */
static void link_objects(const struct kiln_pages_params *p, const struct kiln_outline *outlines, struct kiln_pages *pages)
{
    for (size_t i = 0; i < p->scene->object_count; i++) {
        const struct kiln_outline *o = &outlines[i];
        const struct kiln_object *object = &p->scene->objects[i];
        const struct kiln_page_info *page = &pages->pages[o->page];
        if (o->run_count == 0)
            continue;
        pages->links[i] = (struct kiln_link){.file = page->file, .page = o->page,
                                             .scale = {(double)object->lightmap_width / page->width, (double)object->lightmap_height / page->height},
                                             .offset = {((double)o->x - o->left) / page->width, ((double)o->y - o->top) / page->height}};
    }
}

static int write_page(const struct kiln_pages_params *p, const struct kiln_outline *outlines, uint32_t index, struct kiln_pages *pages,
                      struct kiln_error *error)
{
    char name[32], path[KILN_PATH_SIZE];
    struct kiln_image *image = NULL;
    struct kiln_page_info *page = &pages->pages[index];
    (void)snprintf(name, sizeof name, "page-%u", index);
    size_page(p, outlines, index, page);
    page->file = keep_name(pages, name, kiln_page_ending(p->format), error);
    int status = page->file == NULL ? KILN_SYSTEM : kiln_path_join(path, p->folder, page->file, error);
    if (status == KILN_OK)
        status = draw_page(p, outlines, index, page, &image, error);
    if (status == KILN_OK)
        status = kiln_page_write(path, p->format, image, &page->range, error);
    kiln_image_destroy(&image);
    return status;
}

static double used_share(const struct kiln_outline *outlines, size_t count, const struct kiln_pages *pages)
{
    double used = 0.0, all = 0.0;
    for (size_t i = 0; i < count; i++)
        used += (double)outlines[i].texels;
    for (size_t i = 0; i < pages->page_count; i++)
        all += (double)pages->pages[i].width * pages->pages[i].height;
    return all > 0.0 ? used / all : 1.0;
}

static int write_atlas(const struct kiln_pages_params *p, struct kiln_pages *pages, struct kiln_error *error)
{
    const size_t objects = p->scene->object_count;
    struct kiln_outline *outlines = NULL;
    uint32_t count = 0;
    int status = kiln_allocate(&outlines, objects, sizeof *outlines, "outlines", error);
    for (size_t i = 0; i < objects && status == KILN_OK; i++)
        if (kiln_export_is_published(p->scene, i))
            status = outline_object(p, i, &outlines[i], error);
    if (status == KILN_OK)
        status = kiln_atlas_pack(outlines, objects, p->atlas, &count, error);
    pages->page_count = status == KILN_OK ? count : 0;
    for (uint32_t i = 0; i < count && status == KILN_OK; i++)
        status = write_page(p, outlines, i, pages, error);
    if (status == KILN_OK) {
        link_objects(p, outlines, pages);
        pages->used = used_share(outlines, objects, pages);
    }
    for (size_t i = 0; outlines != NULL && i < objects; i++)
        kiln_free(&outlines[i].runs);
    kiln_free(&outlines);
    return status;
}

/* ---- */

int kiln_pages_write(struct kiln_pages **result, const struct kiln_pages_params *p, struct kiln_error *error)
{
    char folder[KILN_PATH_SIZE];
    struct kiln_pages *pages = NULL;
    const size_t objects = p->scene->object_count;
    *result = NULL;
    int status = kiln_allocate(&pages, 1, sizeof *pages, "the pages", error);
    if (status != KILN_OK)
        return status;
    pages->used = 1.0;
    status = kiln_allocate(&pages->links, objects, sizeof *pages->links, "the pages", error);
    if (status == KILN_OK)
        status = kiln_allocate(&pages->pages, objects, sizeof *pages->pages, "the pages", error);
    if (status == KILN_OK)
        status = kiln_allocate(&pages->names, objects, sizeof *pages->names, "the pages", error);
    if (status == KILN_OK)
        status = kiln_path_join(folder, p->folder, "lightmaps", error);
    if (status == KILN_OK)
        status = kiln_make_directories(folder, error);
    if (status == KILN_OK)
        status = p->atlas == 0 ? write_own_pages(p, pages, error) : write_atlas(p, pages, error);
    if (status != KILN_OK)
        kiln_pages_destroy(&pages);
    *result = pages;
    return status;
}

void kiln_pages_destroy(struct kiln_pages **pointer)
{
    struct kiln_pages *pages = *pointer;
    if (pages == NULL)
        return;
    for (size_t i = 0; i < pages->name_count; i++)
        kiln_free(&pages->names[i]);
    kiln_free(&pages->names);
    kiln_free(&pages->pages);
    kiln_free(&pages->links);
    kiln_free(pointer);
}
