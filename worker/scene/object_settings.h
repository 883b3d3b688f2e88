/* Settings of single objects, as numbers: those that a scene file gives its objects, and those that the rules of a job
 * add. coordinator/job/object_settings.h has their keys. The scene file of a part keeps them
 * (KILN_SECTION_OBJECT_SETTINGS), since its lightmaps get their sizes only when the parts are put together. */
#ifndef KILN_WORKER_SCENE_OBJECT_SETTINGS_H
#define KILN_WORKER_SCENE_OBJECT_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

enum kiln_object_role { KILN_ROLE_UNSET = 0, KILN_ROLE_BOTH, KILN_ROLE_CASTER_ONLY, KILN_ROLE_RECEIVER_ONLY };
enum kiln_object_sides { KILN_SIDES_UNSET = 0, KILN_SIDES_ONE, KILN_SIDES_TWO };
enum kiln_object_exclude { KILN_EXCLUDE_UNSET = 0, KILN_EXCLUDE_NO, KILN_EXCLUDE_YES };

/* All zero: no settings. */
struct kiln_object_settings {
    double density_scale;
    uint32_t lightmap_size;
    uint8_t role, sides, exclude; /* the enums above */
    bool size_of_file;            /* the scene file itself sets that density or size, not a rule of the job */
    /* Levels of detail in the file (coordinator/import/lods.h); in each member 0: none. There are no keys for these. */
    uint32_t lod_level;  /* the level + 1: 1 is the finest */
    uint32_t lod_member; /* a number that the objects of one level of one thing share */
    uint32_t lod_group;  /* a number that the levels of one thing share */
    uint32_t lod_name;   /* name that contains the level: an offset into the scene's strings */
};

#endif
