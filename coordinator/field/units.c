#include "coordinator/field/units.h"

#include <string.h>

static const struct kiln_units radiometric = {"radiometric", "W m-2", "W/m2", "W m-2 sr-1", "W sr-1", "W"};
static const struct kiln_units photometric = {"photometric", "lx", "lx", "cd m-2", "cd", "lm"};

const struct kiln_units *kiln_units_of(int choice, const struct kiln_scene *scene)
{
    if (choice != KILN_UNITS_AUTO)
        return choice == KILN_UNITS_PHOTOMETRIC ? &photometric : &radiometric;
    return scene->header->units == KILN_SCENE_UNITS_PHOTOMETRIC || scene->header->units == KILN_SCENE_UNITS_BLENDER
               ? &photometric
               : &radiometric;
}

const char *kiln_units_reason(int choice, const struct kiln_scene *scene)
{
    static const char *const reasons[] = {"the file does not say", "the file says so", "the file says so",
                                          "Blender's exporter writes lights so"};
    /* in the order of enum kiln_scene_units */
    return choice != KILN_UNITS_AUTO ? "asked for" : reasons[scene->header->units];
}

const struct kiln_units *kiln_units_named(const char *kind)
{
    return kind != NULL && strcmp(kind, photometric.kind) == 0 ? &photometric : &radiometric;
}
