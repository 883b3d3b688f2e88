#include "coordinator/view/texel_place.h"

#include <stdio.h>
#include <string.h>

/* The last comma before `end`; NULL: there is none. */
static const char *comma_before(const char *text, const char *end)
{
    while (end > text && *--end != ',') {
    }
    return end > text ? end : NULL;
}

int kiln_texel_place_read(struct kiln_texel_place *place, const struct kiln_scene *scene, const char *texel,
                          struct kiln_error *error)
{
    const char *last = comma_before(texel, texel + strlen(texel)),
               *middle = last != NULL ? comma_before(texel, last) : NULL;
    char more;
    *place = (struct kiln_texel_place){0};
    if (middle == NULL || sscanf(middle, ",%u,%u%c", &place->x, &place->y, &more) != 2)
        return kiln_fail(error, KILN_USAGE, "--texel %.100s: give OBJECT,X,Y, such as floor,3,4", texel);
    const size_t length = (size_t)(middle - texel);
    for (; place->object < scene->object_count; place->object++) {
        const char *name = kiln_scene_string(scene, scene->objects[place->object].name);
        if (strlen(name) == length && strncmp(name, texel, length) == 0)
            return KILN_OK;
    }
    return kiln_fail(error, KILN_USAGE, "--texel %.100s: the scene has no object of that name (kiln info lists them)",
                     texel);
}

int kiln_texel_place_refuse(const char *texel, struct kiln_error *error)
{
    return kiln_fail(error, KILN_USAGE,
                     "--texel %.100s: no surface lies in that texel; kiln view --show texels --atlas OBJECT shows "
                     "which have some",
                     texel);
}
