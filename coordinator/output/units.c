#include "coordinator/output/units.h"

#include <jansson.h>
#include <string.h>

#include "coordinator/output/publish.h"
#include "worker/base/memory.h"

static const struct kiln_units radiometric = {"radiometric", "W m-2", "W/m2", "W m-2 sr-1", "W sr-1", "W"};
static const struct kiln_units photometric = {"photometric", "lx", "lx", "cd m-2", "cd", "lm"};

const struct kiln_units *kiln_units_of(int choice, const struct kiln_scene *scene)
{
    if (choice != KILN_UNITS_AUTO)
        return choice == KILN_UNITS_PHOTOMETRIC ? &photometric : &radiometric;
    return scene->header->units == KILN_SCENE_UNITS_PHOTOMETRIC || scene->header->units == KILN_SCENE_UNITS_BLENDER ? &photometric : &radiometric;
}

const char *kiln_units_reason(int choice, const struct kiln_scene *scene)
{
    static const char *const reasons[] = {"the file does not say", "the file says so", "the file says so", "Blender's exporter writes lights so"};
    return choice != KILN_UNITS_AUTO ? "asked for" : reasons[scene->header->units]; /* in the order of enum kiln_scene_units */
}

const struct kiln_units *kiln_units_of_bake(const char *directory)
{
    char path[KILN_PATH_SIZE], *text = NULL;
    size_t size = 0;
    const struct kiln_units *found = &radiometric;
    if (kiln_path_join(path, directory, "run.json", NULL) == KILN_OK && kiln_read_file(path, 1u << 30, &text, &size, NULL) == KILN_OK) {
        json_t *run = json_loadb(text, size, 0, NULL);
        const char *kind = json_string_value(json_object_get(json_object_get(run, "units"), "kind"));
        if (kind != NULL && strcmp(kind, photometric.kind) == 0)
            found = &photometric;
        json_decref(run);
    }
    kiln_free(&text);
    return found;
}
