/* The state of an OBJ file and its material files while they are read. Private to coordinator/import/obj*.c. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_DOCUMENT_H
#define KILN_COORDINATOR_IMPORT_OBJ_DOCUMENT_H

#include "coordinator/import/image.h"
#include "coordinator/import/kinds.h"
#include "coordinator/import/missing.h"
#include "coordinator/import/numbers.h"
#include "coordinator/import/obj_symbols.h"
#include "coordinator/import/obj_text.h"

/* A map statement: a texture whose coordinates are scaled, then shifted. */
struct obj_map {
    size_t path; /* offset into obj_materials.text; 0: none */
    float scale[2], offset[2];
    bool clamp, moved; /* moved: a scale or an offset was given */
};

/* Non-diffuse properties of a material in an .mtl file, as stored there. */
struct obj_gloss {
    /* Ks, Tf, Ns, Ni; and the extension for physically based materials: Pr, Pm, Pc, Pcr, aniso, anisor */
    float specular[3], filter[3], exponent, ior;
    float roughness, metallic, clearcoat, clearcoat_roughness, anisotropy, rotation;
    float illum; /* the illumination model, 0 to 10 */
    bool has_filter, has_exponent, has_roughness;
    bool physical;   /* the material has statements of the extension */
    uint64_t mended; /* count of numbers that were clamped to their range, and of unread statements */
    struct obj_map specular_map, exponent_map, roughness_map, metallic_map;
};

struct obj_material {
    /* offsets into obj_materials.text; folder: that of the material file, with a slash, or empty */
    size_t name, folder;
    float diffuse[3], emission[3], alpha;
    struct obj_map diffuse_map, emission_map;
    struct obj_gloss gloss;
    struct obj_map alpha_map; /* only its presence matters: kiln does not read it */
    bool defined;             /* a newmtl defines it */
    bool glossy;              /* the builder has a struct kiln_gloss for the material */
};

struct obj_materials {
    struct kiln_confine *confine;
    struct kiln_builder *builder;
    struct kiln_error *error;
    struct obj_material *list; /* the first is for faces without a material */
    size_t count, capacity;
    struct obj_symbols names;
    char *text; /* NUL-terminated strings; the first is empty */
    size_t text_size, text_capacity;
    struct kiln_images images;
    struct obj_symbols textures; /* the builder's texture by path and wrapping */
    struct obj_symbols told;     /* missing or moved pictures, by name, that were reported already */
    struct kiln_missing missing; /* missing pictures */
    struct kiln_kinds unused;    /* statements that are not read, by keyword */
    uint64_t physical;           /* number of statements Pr, Pm and their maps */
    uint64_t sheen;              /* number of statements Ps and map_Ps */
    uint64_t mended;             /* sum of obj_gloss.mended over the materials with gloss */
};

/* obj_material.c. Each function returns a status and writes the error sentence. */
int obj_materials_begin(struct obj_materials *materials);
void obj_materials_end(struct obj_materials *materials);
/* Reads "mtllib NAMES": one name that contains blanks, if there is such a file, else several names. */
int obj_read_libraries(struct obj_materials *materials, struct obj_word names);
/* The material of that name; appended if it does not exist yet. */
int obj_find_material(struct obj_materials *materials, struct obj_word name, uint32_t *index);
/* Appends all materials with their textures to the builder, in the order of the list. */
int obj_add_materials(struct obj_materials *materials);
/* Finds the builder's texture for a map; materials that name the same file share it. `srgb`: its colours are coded in
 * sRGB; else they are linear. `what` is the statement, for sentences. *index stays unchanged if there is no map. If its
 * picture is missing, *index becomes KILN_NONE, and a note says `instead` (missing.h). */
int obj_find_texture(struct obj_materials *materials, const struct obj_material *material, const struct obj_map *map,
                     bool srgb, const char *what, const char *instead, uint32_t *index);
/* Whether the map's file can be opened, or is missing. */
bool obj_map_opens(struct obj_materials *materials, const struct obj_material *material, const struct obj_map *map);

/* obj_gloss.c. Sets the defaults of a new material. */
void obj_gloss_begin(struct obj_gloss *gloss);
/* Appends the gloss of a material (`index` in the builder), unless the material is purely diffuse; sets
 * material->glossy. */
int obj_add_gloss(struct obj_materials *materials, struct obj_material *material, uint32_t index);

#endif
