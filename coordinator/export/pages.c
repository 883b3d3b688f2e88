#include "coordinator/export/pages.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/output/exr.h"
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
int kiln_pages_read(const struct kiln_pages_params *p, size_t object, const char *const *wanted, size_t count, struct kiln_image **image,
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
        status = kiln_pages_read(p, object, wanted, 3, &image, error);
    if (status == KILN_OK)
        status = kiln_page_write(path, p->format, image, &page->range, error);
    if (status == KILN_OK)
        pages->links[object] = (struct kiln_link){.file = page->file, .page = (uint32_t)pages->page_count++, .scale = {1.0, 1.0}};
    kiln_image_destroy(&image);
    return status;
}

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
    for (size_t i = 0; i < objects && status == KILN_OK; i++)
        if (kiln_export_is_published(p->scene, i))
            status = write_own_page(p, i, pages, error);
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
