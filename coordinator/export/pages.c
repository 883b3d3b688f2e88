#include "coordinator/export/pages.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/export/atlas.h"
#include "coordinator/output/map/charts/nearest.h"
#include "coordinator/files/publish.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Makes the name "lightmaps/NAME.exr", which `pages` owns. NULL when out of memory. */
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

/* Reads the channels `wanted` of an object's lightmap or of that of its backs, and checks that its size is the
 * scene's. */
static int read_lightmap(const struct kiln_pages_params *p, size_t object, bool back, const char *const *wanted,
                         size_t count, struct kiln_image **image, struct kiln_error *error)
{
    char name[KILN_PATH_SIZE];
    const struct kiln_object *o = &p->scene->objects[object];
    (void)snprintf(name, sizeof name, "lightmaps/%s%s.exr", back ? "back/" : "", kiln_scene_string(p->scene, o->name));
    int status = kiln_results_image(p->results, name, wanted, count, image, error);
    if (status == KILN_OK && ((*image)->width != o->lightmap_width || (*image)->height != o->lightmap_height))
        status =
            kiln_fail(error, KILN_BAD_INPUT, "%.512s has %u x %u texels, but the scene file says %u x %u; bake again",
                      name, (*image)->width, (*image)->height, o->lightmap_width, o->lightmap_height);
    return status;
}

static bool has_back(const struct kiln_pages_params *p, size_t object)
{
    return p->has_back != NULL && p->has_back[object] != 0;
}

/* Writes one lightmap as a page of its own; *file is its name, which `pages` owns. */
static int write_lightmap(const struct kiln_pages_params *p, size_t object, bool back, struct kiln_pages *pages,
                          const char **file, double *range, struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    char name[256];
    struct kiln_image *image = NULL;
    *range = p->range;
    (void)snprintf(name, sizeof name, "%s%s", back ? "back/" : "",
                   kiln_scene_string(p->scene, p->scene->objects[object].name));
    *file = keep_name(pages, name, kiln_page_extension(p->format), error);
    int status;
    KILN_TRY(*file == NULL ? KILN_SYSTEM : KILN_OK);
    KILN_TRY(read_lightmap(p, object, back, wanted, 3, &image, error));
    KILN_TRY(kiln_make_parents(p->folder, *file, error));
    KILN_TRY(kiln_page_write(p->folder, *file, p->format, image, range, error));
end:
    kiln_image_destroy(&image);
    return status;
}

static int write_own_page(const struct kiln_pages_params *p, size_t object, struct kiln_pages *pages,
                          struct kiln_error *error)
{
    const struct kiln_object *o = &p->scene->objects[object];
    struct kiln_page_info *page = &pages->pages[pages->page_count];
    struct kiln_link *link = &pages->links[object];
    *page = (struct kiln_page_info){.width = o->lightmap_width, .height = o->lightmap_height};
    int status;
    KILN_TRY(write_lightmap(p, object, false, pages, &page->file, &page->range, error));
    *link = (struct kiln_link){.file = page->file, .page = (uint32_t)pages->page_count++, .scale = {1.0, 1.0}};
    if (has_back(p, object))
        KILN_TRY(write_lightmap(p, object, true, pages, &link->back, &link->back_range, error));
end:
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

struct atlas {
    const struct kiln_pages_params *params;
    struct kiln_pages *pages;
    struct kiln_islands islands;
    size_t *first;   /* one per object, and one more at the end: its first island */
    uint32_t *users; /* per mesh: number of objects with a lightmap that share it */
};

/* Whether an object's layout must stay in one piece: the object shares its mesh, and the coordinates belong to the
 * mesh. */
static bool is_whole(const struct atlas *a, size_t object)
{
    return a->users[a->params->scene->objects[object].mesh] > 1;
}

static int misfit(const struct kiln_pages_params *p, size_t object, struct kiln_error *error)
{
    const struct kiln_object *o = &p->scene->objects[object];
    return kiln_fail(error, KILN_BAD_INPUT,
                     "object '%s': its lightmap of %u x %u texels does not fit a page of %u x %u; give a larger "
                     "--atlas, or bake it with fewer texels "
                     "(--texels-per-metre, --lightmap-max)",
                     kiln_scene_string(p->scene, o->name), o->lightmap_width, o->lightmap_height, p->atlas, p->atlas);
}

/* Adds the islands of what the object's layout covers. */
static int add_islands(struct atlas *a, size_t object, struct kiln_error *error)
{
    const struct kiln_pages_params *p = a->params;
    static const char *const wanted[] = {"coverage.Y", "validity.Y"};
    const struct kiln_object *o = &p->scene->objects[object];
    const size_t count = (size_t)o->lightmap_width * o->lightmap_height;
    struct kiln_image *image = NULL;
    uint8_t *covered = NULL;
    int status = read_lightmap(p, object, false, wanted, 2, &image, error);
    if (status == KILN_OK)
        status = kiln_allocate(&covered, count, 1, "covered texels", error);
    const struct kiln_image_channel *coverage = status == KILN_OK ? kiln_image_find(image, "coverage.Y") : NULL;
    const struct kiln_image_channel *validity = status == KILN_OK ? kiln_image_find(image, "validity.Y") : NULL;
    KILN_TRY(status);
    if (coverage == NULL || validity == NULL)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "%.512s: the lightmap of '%s' has no coverage and validity; bake again", p->directory,
                           kiln_scene_string(p->scene, o->name)));
    for (size_t i = 0; i < count; i++)
        /* coverage is a half float: small values may have become 0 */
        covered[i] = coverage->values[i] > 0.0f || validity->values[i] > 0.25f;
    KILN_TRY(kiln_islands_add(&a->islands, covered, o->lightmap_width, o->lightmap_height, is_whole(a, object),
                              (uint32_t)object, error));
end:
    kiln_free(&covered);
    kiln_image_destroy(&image);
    return status;
}

/* Copies an island's texels. Beyond the lightmap's edge the texels at the edge are repeated. */
static void copy_texels(struct kiln_image *page, uint8_t *state, float *const to[3], const struct kiln_island *o,
                        const struct kiln_image *image, float *const from[3])
{
    for (size_t i = 0; i < o->run_count; i++) {
        const struct kiln_island_run *run = &o->runs[i];
        const int64_t v = (int64_t)o->top + run->row, y = v < 0                ? 0
                                                          : v >= image->height ? (int64_t)image->height - 1
                                                                               : v;
        for (uint32_t k = run->first; k < run->end; k++) {
            const int64_t u = (int64_t)o->left + k, x = u < 0 ? 0 : u >= image->width ? (int64_t)image->width - 1 : u;
            const size_t target = (size_t)(o->y + run->row) * page->width + o->x + k,
                         source = (size_t)y * image->width + (size_t)x;
            for (int c = 0; c < 3; c++)
                to[c][target] = from[c][source];
            state[target] = 1;
        }
    }
}

/* Fills the texels outside all islands with the nearest island texel. */
static int fill_page(const struct kiln_image *page, const uint8_t *state, float *const planes[3],
                     struct kiln_error *error)
{
    const size_t count = (size_t)page->width * page->height;
    uint32_t *nearest = NULL;
    int status;
    KILN_TRY(kiln_allocate(&nearest, count, sizeof *nearest, "nearest texels", error));
    KILN_TRY(kiln_nearest_texels(state, 1, page->width, page->height, nearest, error));
    for (size_t i = 0; i < count; i++)
        for (int c = 0; nearest[i] != KILN_NONE && c < 3; c++)
            planes[c][i] = planes[c][nearest[i]];
end:
    kiln_free(&nearest);
    return status;
}

/* Sets the page's size to that of its islands, rounded up to a multiple of 4 for block compression. */
static void size_page(const struct atlas *a, uint32_t index, struct kiln_page_info *page)
{
    const uint32_t most = a->params->atlas;
    *page = (struct kiln_page_info){.range = a->params->range};
    for (size_t i = 0; i < a->islands.count; i++) {
        const struct kiln_island *o = &a->islands.islands[i];
        if (o->page != index)
            continue;
        page->width = o->x + o->width > page->width ? o->x + o->width : page->width;
        page->height = o->y + o->height > page->height ? o->y + o->height : page->height;
    }
    page->width = (page->width + 3) / 4 * 4 < most ? (page->width + 3) / 4 * 4 : most;
    page->height = (page->height + 3) / 4 * 4 < most ? (page->height + 3) / 4 * 4 : most;
}

static bool is_on(const struct atlas *a, size_t object, uint32_t page)
{
    return a->first[object] < a->first[object + 1] && a->islands.islands[a->first[object]].page == page;
}

static int draw_object(const struct atlas *a, size_t object, bool back, struct kiln_image *page, uint8_t *state,
                       float *const to[3], struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    float *from[3];
    struct kiln_image *image = NULL;
    int status;
    KILN_TRY(read_lightmap(a->params, object, back, names, 3, &image, error));
    if (!kiln_image_rgb(image, "", from))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.512s: a lightmap has no channels R, G and B; bake again",
                           a->params->directory));
    for (size_t i = a->first[object]; i < a->first[object + 1]; i++)
        copy_texels(page, state, to, &a->islands.islands[i], image, from);
end:
    kiln_image_destroy(&image);
    return status;
}

/* Draws a page. With `back`: only backs of the objects on it, if they have a lightmap. */
static int draw_page(const struct atlas *a, uint32_t index, bool back, struct kiln_image **page,
                     struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const struct kiln_page_info *info = &a->pages->pages[index];
    float *to[3];
    uint8_t *state = NULL;
    int status;
    KILN_TRY(kiln_image_create(page, info->width, info->height, names, 3, error));
    KILN_TRY(kiln_allocate(&state, (size_t)info->width * info->height, 1, "a page", error));
    (void)kiln_image_rgb(*page, "", to);
    for (size_t i = 0; i < a->params->scene->object_count; i++)
        if (is_on(a, i, index) && (!back || has_back(a->params, i)))
            KILN_TRY(draw_object(a, i, back, *page, state, to, error));
    KILN_TRY(fill_page(*page, state, to, error));
end:
    kiln_free(&state);
    return status;
}

static int write_side(const struct atlas *a, uint32_t index, bool back, const char **file, double *range,
                      struct kiln_error *error)
{
    char name[32];
    struct kiln_image *image = NULL;
    *range = a->params->range;
    (void)snprintf(name, sizeof name, "page-%u%s", index, back ? "-back" : "");
    *file = keep_name(a->pages, name, kiln_page_extension(a->params->format), error);
    int status;
    KILN_TRY(*file == NULL ? KILN_SYSTEM : KILN_OK);
    KILN_TRY(draw_page(a, index, back, &image, error));
    KILN_TRY(kiln_page_write(a->params->folder, *file, a->params->format, image, range, error));
end:
    kiln_image_destroy(&image);
    return status;
}

/* Writes a page and, if an object on it has backs, the page of backs with the same layout. */
static int write_page(const struct atlas *a, uint32_t index, struct kiln_error *error)
{
    struct kiln_page_info *page = &a->pages->pages[index];
    const char *back = NULL;
    double back_range = 0.0;
    size_page(a, index, page);
    int status = write_side(a, index, false, &page->file, &page->range, error);
    for (size_t i = 0; i < a->params->scene->object_count && status == KILN_OK; i++) {
        if (!is_on(a, i, index) || !has_back(a->params, i))
            continue;
        if (back == NULL)
            status = write_side(a, index, true, &back, &back_range, error);
        a->pages->links[i].back = back;
        a->pages->links[i].back_range = back_range;
    }
    return status;
}

/* ---- coordinates ---- */

/* The island that a texel of the lightmap belongs to, or the nearest one. `grid` is one larger on each side (number +
 * 1; 0: none). */
static uint32_t island_at(const uint32_t *grid, int64_t width, int64_t height, int64_t x, int64_t y)
{
    for (int64_t ring = 0; ring < (width > height ? width : height) + 2; ring++)
        for (int64_t v = y - ring; v <= y + ring; v++)
            for (int64_t u = x - ring; u <= x + ring; u += v == y - ring || v == y + ring || ring == 0 ? 1 : 2 * ring)
                if (u >= -1 && u <= width && v >= -1 && v <= height && grid[(v + 1) * (width + 2) + u + 1] != 0)
                    return grid[(v + 1) * (width + 2) + u + 1] - 1;
    return 0;
}

static void draw_grid(uint32_t *grid, const struct kiln_object *o, const struct kiln_island *islands, size_t count)
{
    const size_t stride = (size_t)o->lightmap_width + 2;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < islands[i].run_count; k++) {
            const struct kiln_island_run *run = &islands[i].runs[k];
            const size_t row = (size_t)(islands[i].top + 1) + run->row;
            for (uint32_t x = run->first; x < run->end; x++)
                grid[row * stride + (size_t)(islands[i].left + 1) + x] = (uint32_t)i + 1;
        }
}

static int64_t texel_of(float coordinate, uint32_t side)
{
    const int64_t texel = (int64_t)((double)coordinate * side);
    return texel < 0 ? 0 : texel >= (int64_t)side ? (int64_t)side - 1 : texel;
}

/* Computes the mesh's coordinates on the page: each vertex moves with its island, by whole texels. */
static int move_coordinates(const struct atlas *a, size_t object, struct kiln_error *error)
{
    const struct kiln_scene *scene = a->params->scene;
    const struct kiln_object *o = &scene->objects[object];
    const struct kiln_mesh *mesh = &scene->meshes[o->mesh];
    const struct kiln_island *islands = a->islands.islands + a->first[object];
    const struct kiln_page_info *page = &a->pages->pages[islands->page];
    uint32_t *grid = NULL;
    const int status = kiln_allocate(&grid, ((size_t)o->lightmap_width + 2) * ((size_t)o->lightmap_height + 2),
                                     sizeof *grid, "islands", error);
    if (status != KILN_OK)
        return status;
    draw_grid(grid, o, islands, a->first[object + 1] - a->first[object]);
    for (uint64_t v = mesh->vertex_first; v < mesh->vertex_first + mesh->vertex_count; v++) {
        const struct kiln_vec2 uv = scene->texcoord_lightmap[v];
        const struct kiln_island *own =
            &islands[island_at(grid, o->lightmap_width, o->lightmap_height, texel_of(uv.x, o->lightmap_width),
                               texel_of(uv.y, o->lightmap_height))];
        a->pages->coordinates[v] =
            (struct kiln_vec2){(float)(((double)uv.x * o->lightmap_width + (double)own->x - own->left) / page->width),
                               (float)(((double)uv.y * o->lightmap_height + (double)own->y - own->top) / page->height)};
    }
    kiln_free(&grid);
    return KILN_OK;
}

/* Fills an object's link. page uv = TEXCOORD x scale + offset: an object's texels coincide with the page's. */
static int link_object(const struct atlas *a, size_t object, struct kiln_error *error)
{
    const struct kiln_object *o = &a->params->scene->objects[object];
    if (a->first[object] == a->first[object + 1])
        return KILN_OK;
    const struct kiln_island *island = &a->islands.islands[a->first[object]];
    const struct kiln_page_info *page = &a->pages->pages[island->page];
    a->pages->links[object].file = page->file;
    a->pages->links[object].page = island->page;
    a->pages->links[object].scale[0] = a->pages->links[object].scale[1] = 1.0;
    if (!is_whole(a, object))
        return move_coordinates(a, object, error);
    a->pages->links[object].scale[0] = (double)o->lightmap_width / page->width;
    a->pages->links[object].scale[1] = (double)o->lightmap_height / page->height;
    a->pages->links[object].offset[0] = ((double)island->x - island->left) / page->width;
    a->pages->links[object].offset[1] = ((double)island->y - island->top) / page->height;
    return KILN_OK;
}

static double used_share(const struct atlas *a)
{
    double used = 0.0, all = 0.0;
    for (size_t i = 0; i < a->islands.count; i++)
        used += (double)a->islands.islands[i].texels;
    for (size_t i = 0; i < a->pages->page_count; i++)
        all += (double)a->pages->pages[i].width * a->pages->pages[i].height;
    return all > 0.0 ? used / all : 1.0;
}

/* Finds the islands of all objects, and copies the coordinates before they are moved. */
static int begin_atlas(struct atlas *a, struct kiln_error *error)
{
    const struct kiln_scene *scene = a->params->scene;
    int status;
    KILN_TRY(kiln_allocate(&a->first, scene->object_count + 1, sizeof *a->first, "islands", error));
    KILN_TRY(kiln_allocate(&a->users, scene->mesh_count, sizeof *a->users, "meshes", error));
    KILN_TRY(kiln_allocate(&a->pages->coordinates, scene->vertex_count, sizeof *a->pages->coordinates,
                           "coordinates on pages", error));
end:
    if (status != KILN_OK)
        return status;
    memcpy(a->pages->coordinates, scene->texcoord_lightmap, scene->vertex_count * sizeof *a->pages->coordinates);
    for (size_t i = 0; i < scene->object_count; i++)
        a->users[scene->objects[i].mesh] += kiln_export_is_published(scene, i);
    for (size_t i = 0; i < scene->object_count && status == KILN_OK; i++) {
        a->first[i] = a->islands.count;
        if (kiln_export_is_published(scene, i))
            status = add_islands(a, i, error);
    }
    a->first[scene->object_count] = a->islands.count;
    return status;
}

static int write_atlas(const struct kiln_pages_params *p, struct kiln_pages *pages, struct kiln_error *error)
{
    struct atlas a = {.params = p, .pages = pages};
    uint32_t count = 0, group = KILN_NONE;
    int status = begin_atlas(&a, error);
    if (status == KILN_OK)
        status = kiln_atlas_pack(&a.islands, p->atlas, &count, &group, error);
    if (group != KILN_NONE)
        status = misfit(p, group, error);
    pages->page_count = status == KILN_OK ? count : 0;
    KILN_TRY(status);
    for (uint32_t i = 0; i < pages->page_count; i++)
        KILN_TRY(write_page(&a, i, error));
    for (size_t i = 0; i < p->scene->object_count; i++)
        KILN_TRY(link_object(&a, i, error));
    pages->used = used_share(&a);
end:
    kiln_free(&a.users);
    kiln_free(&a.first);
    kiln_islands_free(&a.islands);
    return status;
}

/* ---- */

int kiln_pages_write(struct kiln_pages **result, const struct kiln_pages_params *p, struct kiln_error *error)
{
    struct kiln_folder folder = {.descriptor = -1};
    struct kiln_pages *pages = NULL;
    const size_t objects = p->scene->object_count;
    *result = NULL;
    int status = kiln_allocate(&pages, 1, sizeof *pages, "the pages", error);
    if (status != KILN_OK)
        return status;
    pages->used = 1.0;
    KILN_TRY(kiln_arena_allocate(&pages->arena, &pages->links, objects, sizeof *pages->links, "the pages", error));
    KILN_TRY(kiln_arena_allocate(&pages->arena, &pages->pages, objects, sizeof *pages->pages, "the pages", error));
    KILN_TRY(kiln_arena_allocate(&pages->arena, &pages->names, 2 * objects, sizeof *pages->names, "the pages", error));
    KILN_TRY(kiln_folder_open(&folder, p->folder, p->has_back != NULL ? "lightmaps/back" : "lightmaps", true, error));
end:
    kiln_folder_close(&folder);
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
    kiln_free(&pages->coordinates);
    kiln_arena_release(&pages->arena);
    kiln_free(pointer);
}
