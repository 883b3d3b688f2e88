#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/view/view.h"
#include "coordinator/view/view_light.h"
#include "coordinator/view/voxel_view.h"

enum { SIDE = 512 };

static bool has_lightmap(const struct kiln_object *object)
{
    return (object->flags & KILN_OBJECT_CASTER_ONLY) == 0 && object->lightmap_width > 0;
}

static int find_object(const struct kiln_scene *scene, const char *name, uint32_t *object, struct kiln_error *error)
{
    char list[256] = "";
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const char *own = kiln_scene_string(scene, scene->objects[i].name);
        const size_t used = strlen(list);
        *object = i;
        if (!has_lightmap(&scene->objects[i]))
            continue;
        if (strcmp(own, name) == 0)
            return KILN_OK;
        (void)snprintf(list + used, sizeof list - used, "%s%s", used > 0 ? ", " : "", own);
    }
    return kiln_fail(error, KILN_USAGE, "--atlas %.100s: there is no lightmap of that object; there is: %s", name,
                     list);
}

/* The value at a place of the lightmap. */
static void color_at(const struct kiln_view_source *source, uint32_t object, const float at[2], float rgb[3])
{
    const bool range = source->field != NULL &&
                       (source->field->meaning == KILN_FIELD_SCALE || source->field->meaning == KILN_FIELD_PLACE);
    if (source->texels)
        kiln_view_texel_color(object, at, rgb);
    else
        kiln_view_map_at(source->maps, object, at, rgb);
    if (source->voxels != NULL)
        kiln_voxel_view_place(source, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] = isfinite(rgb[c]) || range ? rgb[c] : 0.0f;
}

static void draw(const struct kiln_view_source *source, uint32_t object, uint32_t zoom, struct kiln_image *image)
{
    float *planes[3];
    (void)kiln_image_rgb(image, "", planes);
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++) {
            const float at[2] = {((float)x + 0.5f) / (float)zoom, ((float)y + 0.5f) / (float)zoom};
            float rgb[3];
            color_at(source, object, at, rgb);
            for (int c = 0; c < 3; c++)
                planes[c][(size_t)y * image->width + x] = rgb[c];
        }
}

int kiln_atlas_make(const struct kiln_view_source *source, const char *object, uint32_t side,
                    const struct kiln_look *look, struct kiln_picture *picture, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    uint32_t index = 0;
    *picture = (struct kiln_picture){.exposure = kiln_plain_exposure, .metering = KILN_METERED_NOTHING};
    if (source->geometry->leaves != NULL)
        return kiln_fail(error, KILN_USAGE, "--atlas %.100s: a bake with --store octree has no lightmaps", object);
    int status = find_object(source->scene, object, &index, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_object *o = &source->scene->objects[index];
    const uint32_t longest = o->lightmap_width > o->lightmap_height ? o->lightmap_width : o->lightmap_height;
    const uint32_t wanted = (side > 0 ? side : SIDE) / longest, zoom = wanted > 1 ? wanted : 1;
    if (!source->texels)
        status = kiln_view_maps_load_object(source->maps, index, error);
    if (status == KILN_OK)
        status =
            kiln_image_create(&picture->image, zoom * o->lightmap_width, zoom * o->lightmap_height, names, 3, error);
    if (status != KILN_OK)
        return status;
    picture->viewpoint =
        (struct kiln_viewpoint){.kind = KILN_VIEW_ATLAS, .camera = kiln_scene_string(source->scene, o->name)};
    draw(source, index, zoom, picture->image);
    return kiln_picture_fit(source, look, picture, error);
}
