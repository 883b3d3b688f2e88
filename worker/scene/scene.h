/* The scene: kiln's own flat scene file, mapped read-only, and pointers to its sections, for all readers.
 *
 * The importer (coordinator/import) writes the file once; every rank maps it. The file is one header followed by
 * sections. A section is an array of one of the structs below: 64-byte aligned, little-endian, without pointers. The
 * header carries a version, the file's size, each section's offset and count, and XXH3-128 of the file. kiln_scene_open
 * checks all of these and every index in the file before it returns, so readers need no checks.
 *
 * Units: metres, linear RGB, right-handed, y up, as in glTF. Matrices are row-major 3 x 4: p' = M[0..2] p + M[3]. */
#ifndef KILN_WORKER_SCENE_SCENE_H
#define KILN_WORKER_SCENE_SCENE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

#include "shaders/shared/passage.h"
#include "shaders/shared/surface.h"
#include "worker/base/status.h"
#include "worker/base/vector.h"
#include "worker/scene/object_settings.h"

#define KILN_SCENE_MAGIC 0x4e434b4cu /* "LKCN" */
/* The latest version. Version 5 added the sections of gloss, version 4 those of normal maps. A scene is written as the
 * oldest version that has all sections it needs: without gloss as version 4, whose header ends before the sections of
 * gloss; without normal maps, too, as version 3 (kiln_scene_sections). */
#define KILN_SCENE_VERSION 5u
#define KILN_SCENE_VERSION_NORMAL_MAPS 4u
#define KILN_SCENE_VERSION_PLAIN 3u
/* The scene file of a part (coordinator/import/parts.h): what a reader took from one file, without layouts and sizes of
 * lightmaps, with the settings that the file gives its objects. kiln_scene_open refuses it. */
#define KILN_SCENE_VERSION_PART 6u

enum kiln_light_kind { KILN_LIGHT_POINT = 0, KILN_LIGHT_SPOT = 1, KILN_LIGHT_DIRECTIONAL = 2 };
enum kiln_environment_kind { KILN_ENVIRONMENT_NONE = 0, KILN_ENVIRONMENT_CONSTANT = 1, KILN_ENVIRONMENT_LATLONG = 2 };

/* A material, as far as diffuse light transport needs it. Diffuse albedo = base_color x texture x (1 - metallic). How
 * much light a material lets through: struct kiln_passage in worker/scene/texture.h. What mirrors, gloss and glass need
 * besides: struct kiln_gloss. */
struct kiln_material {
    uint32_t name;               /* offset into `strings` */
    float base_color[4];         /* linear, 0..1; [3] is alpha */
    float emission[3];           /* radiance: factor x strength, W m-2 sr-1, >= 0 */
    uint32_t base_color_texture; /* KILN_NONE: none */
    uint32_t emission_texture;   /* KILN_NONE: none; multiplies `emission` */
    uint32_t alpha_mode;         /* KILN_ALPHA_OPAQUE ... */
    float alpha_cutoff;          /* for KILN_ALPHA_MASK */
    uint32_t double_sided;       /* 0 or 1: emits and reflects on both faces */
    float metallic;              /* factor x mean of its texture, 0..1; metal has no diffuse part */
    float roughness;             /* factor, 0..1 */
    /* KHR_materials_transmission: fraction of the light, 0..1, that a thin wall of the material lets through */
    float transmission;
    /* Read at the base colour's coordinates; its red channel multiplies `transmission`. KILN_NONE: none. Ignored where
     * `transmission` is 0 */
    uint32_t transmission_texture;
};

/* The normal map of a material. Light transport does not read it; coordinator/view does. A texel's red, green and blue,
 * 0 to 1, are the tangent-space normal (2 red - 1, 2 green - 1, 2 blue - 1): x along the texture's u, y against its v,
 * z out of the surface (glTF 2.0, section 3.9.3, normalTexture). */
struct kiln_normal_map {
    uint32_t material; /* ascending in the section: at most one for each material */
    uint32_t texture;  /* a linear one */
    float scale;       /* multiplies x and y */
};

/* ---- gloss: properties of a material besides its diffuse part (worker/scene/gloss.h) ---- */

/* Uses of a texture in struct kiln_gloss: the member that it multiplies or replaces. */
enum kiln_gloss_use {
    KILN_GLOSS_METALLIC,            /* x metallic */
    KILN_GLOSS_ROUGHNESS,           /* x roughness; Phong: x exponent */
    KILN_GLOSS_TRANSMISSION,        /* x transmission */
    KILN_GLOSS_SPECULAR,            /* x specular */
    KILN_GLOSS_SPECULAR_COLOR,      /* x specular_color, red green blue */
    KILN_GLOSS_THICKNESS,           /* x thickness */
    KILN_GLOSS_CLEARCOAT,           /* x clearcoat */
    KILN_GLOSS_CLEARCOAT_ROUGHNESS, /* x clearcoat_roughness */
    /* the clear coat's normal map, as struct kiln_normal_map says, with clearcoat_normal_scale */
    KILN_GLOSS_CLEARCOAT_NORMAL,
    /* direction of the highlight's long axis: (2 red - 1, 2 green - 1), x along the texture's u, y against its v;
     * anisotropy_rotation is added. blue: x anisotropy */
    KILN_GLOSS_ANISOTROPY,
    KILN_GLOSS_USES
};

/* A texture of a material. (u, v) is the vertices' texcoord_gloss, interpolated; the texture is read at u' = t[0] u +
 * t[1] v + t[2], v' = t[3] u + t[4] v + t[5], where t is `transform`. */
struct kiln_gloss_texture {
    uint32_t texture; /* KILN_NONE: none */
    uint32_t channel; /* 0..3: channel read: red, green, blue, alpha; 0 if several are */
    float transform[6];
};

enum kiln_gloss_model {
    KILN_GLOSS_METALLIC_ROUGHNESS = 0, /* glTF 2.0, appendix B, with the extensions KHR_materials_... named below */
    /* Phong, from an .mtl file: the specular lobe is specular_color x (cosine to the mirror direction)^exponent. It
     * uses the members specular_color, exponent, ior, transmission, filter; metallic is 0, roughness 1 */
    KILN_GLOSS_PHONG = 1
};
enum {
    /* KHR_materials_volume with a thickness above 0, or illum 6 and 7 of an .mtl file: the mesh bounds a body, and
     * light bends at both faces. Without it a material that transmits is a thin wall */
    KILN_GLOSS_VOLUME = 1,
    KILN_GLOSS_MIRROR = 2, /* Phong: illum 3 to 7, the specular lobe is an ideal mirror of specular_color */
    /* Phong: `transmission` repeats 1 - alpha of struct kiln_material. Code that uses `transmission` must treat the
     * surface as opaque */
    KILN_GLOSS_ALPHA_TRANSMITS = 4
};

/* Gloss of a material: its properties besides the diffuse part. Diffuse materials (kiln_gloss_kind) that
 * kiln_gloss_default describes fully have none; scenes with only such materials have no gloss section. Numbers are
 * factors, before their textures; angles are counter-clockwise about the normal, seen from the front. */
struct kiln_gloss {
    uint32_t material;            /* ascending in the section: at most one for each material */
    uint32_t model;               /* enum kiln_gloss_model */
    uint32_t flags;               /* KILN_GLOSS_VOLUME ... */
    float metallic, roughness;    /* 0..1; alpha of the microfacets is roughness^2 */
    float mean_metallic;          /* metallic x mean of its texture */
    float mean_roughness;         /* roughness x mean of its texture; Phong: of an equally wide lobe */
    float ior;                    /* >= 1, or 0: an index so high that all light is reflected (KHR_materials_ior) */
    float specular;               /* KHR_materials_specular: 0..1 */
    float specular_color[3];      /* linear, >= 0; Phong: Ks, 0..1 */
    float transmission;           /* KHR_materials_transmission: 0..1 */
    float filter[3];              /* 0..1; Phong: Tf, the colour that is let through; else 1 1 1 */
    float thickness;              /* KHR_materials_volume: m in mesh space, >= 0; only above 0 matters for rays */
    float attenuation_color[3];   /* 0..1: what white light becomes after attenuation_distance in the body */
    float attenuation_distance;   /* m, world space; 0: the body absorbs nothing */
    float dispersion;             /* KHR_materials_dispersion: 20 / Abbe number, >= 0; 0: none */
    float clearcoat;              /* KHR_materials_clearcoat: 0..1 */
    float clearcoat_roughness;    /* 0..1 */
    float clearcoat_normal_scale; /* of the clear coat's normal map: multiplies x and y */
    float anisotropy;             /* KHR_materials_anisotropy: strength, 0..1 */
    float anisotropy_rotation;    /* radians, from the tangent on; the tangent is along u of texcoord_gloss */
    float exponent;               /* Phong: Ns, >= 0; else 0 */
    struct kiln_gloss_texture textures[KILN_GLOSS_USES];
};

/* An image, 8 bits a channel RGBA. Texel (0,0) is the top left, at texture coordinate (0,0) as in glTF. */
struct kiln_texture {
    uint64_t first; /* first byte in `texels` */
    uint32_t width, height;
    uint32_t srgb;           /* 1: RGB are sRGB-coded (alpha never is) */
    uint32_t wrap_u, wrap_v; /* KILN_WRAP_REPEAT ... */
    uint32_t nearest;        /* 1: nearest filter, 0: bilinear */
    uint32_t reserved[2];
};

/* A mesh: a range of vertices and one of triangles. Triangle corners are indices relative to vertex_first. */
struct kiln_mesh {
    uint32_t name;
    uint32_t flags; /* KILN_MESH_* */
    uint64_t vertex_first, vertex_count;
    uint64_t triangle_first, triangle_count;
    double surface_area; /* m2 before any transform */
    double uv_area;      /* area of the lightmap layout, as a fraction of the unit square */
};
enum {
    KILN_MESH_SMOOTH = 1,          /* shading normals differ from geometric ones somewhere */
    KILN_MESH_UNWRAPPED = 2,       /* the lightmap layout is kiln's own */
    KILN_MESH_REPACKED = 8,        /* the layout is the mesh's own charts, packed anew */
    KILN_MESH_HAS_EMISSION_UV = 4, /* texcoord_emission differs from texcoord_base somewhere */
    KILN_MESH_NO_LAYOUT = 16,      /* there is no layout: all of texcoord_lightmap is 0 */
    KILN_MESH_POSED = 32,          /* skins or morph targets moved its vertices: positions are not those of the file */
    /* of a part: the file has a second UV set for the mesh, which texcoord_lightmap repeats, unchecked */
    KILN_MESH_HAS_SECOND_UV = 64,
    KILN_MESH_SOUND_SECOND_UV = 128 /* of a part: that set was checked, has no flaw and covers mesh.uv_area */
};

/* An object: one placed instance of a mesh, with a lightmap of its own. */
struct kiln_object {
    /* the node's name, made unique and safe as a file name: [A-Za-z0-9._-], never starting with '.'; of an object from
     * a part: PART/NAME, both safe */
    uint32_t name;
    uint32_t mesh;
    double transform[12];                     /* mesh to world, row-major 3 x 4 */
    uint32_t lightmap_width, lightmap_height; /* texels, >= 1 */
    uint32_t flipped;                         /* 1: the transform mirrors; front faces are then clockwise */
    uint32_t original_name;                   /* the node's name as it stood in the file */
    /* indices of the node and its mesh in the glTF source; KILN_NONE for other sources */
    uint32_t source_node, source_mesh;
    uint32_t flags;          /* KILN_OBJECT_* */
    uint32_t density_reason; /* enum kiln_density_reason */
    /* index among its node's instances (EXT_mesh_gpu_instancing); KILN_NONE: no instance */
    uint32_t source_instance, unused;
};
enum {
    KILN_OBJECT_CASTER_ONLY = 1,   /* blocks and reflects light; its lightmap is not published */
    KILN_OBJECT_RECEIVER_ONLY = 2, /* has a lightmap; no ray hits it */
    KILN_OBJECT_BOTH_SIDES = 4,    /* the lightmap of its backs, if it has double-sided triangles, is published */
    /* the lightmap of its backs is not published, even if the job asks for that of all objects */
    KILN_OBJECT_ONE_SIDE = 8,
    /* the lightmap of its backs is as fine as that of its front, even if only rays see it: charts would share texels in
     * a coarser one */
    KILN_OBJECT_FINE_BACKS = 16
};
/* Why an object's lightmap has another density than the header's. */
enum kiln_density_reason {
    KILN_DENSITY_COMMON = 0, /* it has the header's density */
    KILN_DENSITY_FRACTION,   /* at that density it would take too large a fraction of all texels */
    KILN_DENSITY_LEAST,      /* at that density it would be too few texels across */
    KILN_DENSITY_SCALED,     /* the user's density-scale for the object */
    KILN_DENSITY_SIZED,      /* the user's lightmap-size for the object */
    KILN_DENSITY_CASTER,     /* caster-only: its lightmap is not published */
    KILN_DENSITY_MAX,        /* limited by the longest side a lightmap may have */
    KILN_DENSITY_PADDING,    /* raised so that two texels lie between its charts */
    KILN_DENSITY_BOUNDED,    /* at that density it would be above twice that of the largest object */
    KILN_DENSITY_REASONS
};

/* A punctual light in world space (KHR_lights_punctual). */
struct kiln_light {
    uint32_t name;
    uint32_t kind;      /* enum kiln_light_kind */
    double position[3]; /* m, world (not relative to the centre) */
    float direction[3]; /* unit, in the direction the light travels */
    float intensity[3]; /* point, spot: W/sr; directional: W/m2 on a facing surface */
    float range;        /* m; 0: no limit */
    float cos_inner, cos_outer;
    uint32_t reserved;
};

struct kiln_camera {
    uint32_t name;
    uint32_t orthographic; /* 1: orthographic, 0: perspective */
    double position[3];
    float forward[3], up[3], right[3]; /* unit */
    /* perspective: vertical angle of view, radians; orthographic: half the height, m */
    float extent_y;
    float aspect; /* width / height; 0: that of the image */
    uint32_t reserved;
};

/* The environment: light from outside the scene. In a lat-long image, direction d has u = 0.5 + atan2(d.x, -d.z)/(2
 * pi), v = acos(d.y)/pi. Texels are RGB floats, top row first. */
struct kiln_environment {
    uint32_t kind;     /* enum kiln_environment_kind */
    float radiance[3]; /* constant: the radiance, W m-2 sr-1; lat-long: a factor on the image */
    float rotation;    /* radians about +y, added to the azimuth */
    uint32_t width, height;
    uint32_t reserved;
};

enum kiln_scene_section {
    KILN_SECTION_STRINGS,            /* char, NUL-terminated UTF-8 */
    KILN_SECTION_MATERIALS,          /* struct kiln_material, at least 1 */
    KILN_SECTION_TEXTURES,           /* struct kiln_texture */
    KILN_SECTION_TEXELS,             /* uint8_t */
    KILN_SECTION_MESHES,             /* struct kiln_mesh */
    KILN_SECTION_OBJECTS,            /* struct kiln_object */
    KILN_SECTION_LIGHTS,             /* struct kiln_light */
    KILN_SECTION_CAMERAS,            /* struct kiln_camera */
    KILN_SECTION_ENVIRONMENT,        /* struct kiln_environment, exactly 1 */
    KILN_SECTION_ENVIRONMENT_TEXELS, /* float RGB, width x height */
    KILN_SECTION_POSITIONS,          /* struct kiln_vec3 a vertex, mesh space */
    KILN_SECTION_NORMALS,            /* struct kiln_vec3 a vertex, unit, mesh space */
    KILN_SECTION_TEXCOORD_BASE,      /* struct kiln_vec2 a vertex: base-colour coordinate, texture transform applied */
    KILN_SECTION_TEXCOORD_EMISSION,  /* struct kiln_vec2 a vertex: emission coordinate, texture transform applied */
    /* struct kiln_vec2 a vertex: coordinates of the lightmap layout, inside 0..1, without overlap */
    KILN_SECTION_TEXCOORD_LIGHTMAP,
    KILN_SECTION_COLORS,             /* uint8_t RGBA a vertex: COLOR_0, linear, multiplies base colour; white without */
    KILN_SECTION_TRIANGLES,          /* uint32_t[3], relative to the mesh's vertex_first, front = counter-clockwise */
    KILN_SECTION_TRIANGLE_MATERIALS, /* uint32_t a triangle */
    KILN_SECTION_SOURCES,            /* struct kiln_source: the files from which the scene was imported */
    KILN_SECTION_NOTES,              /* struct kiln_note: what the importer noticed, changed or left out */
    /* struct kiln_triangle_source a triangle, or none at all: the triangle's place in its source */
    KILN_SECTION_TRIANGLE_SOURCES,
    /* version 4 */
    KILN_SECTION_NORMAL_MAPS, /* struct kiln_normal_map */
    /* struct kiln_vec2 a vertex, or none at all if there is no normal map: normal-map coordinate, texture transform
     * applied; the base-colour coordinate where a material has no normal map */
    KILN_SECTION_TEXCOORD_NORMAL,
    /* version 5 */
    KILN_SECTION_GLOSS, /* struct kiln_gloss */
    /* struct kiln_vec2 a vertex, or none at all if there is no gloss: the coordinate of the set that the textures of
     * the vertex's gloss use, no transform applied; the base-colour coordinate where a material has none */
    KILN_SECTION_TEXCOORD_GLOSS,
    /* version 6, of a part */
    KILN_SECTION_OBJECT_SETTINGS, /* struct kiln_object_settings an object */
    KILN_SECTION_COUNT
};

/* Place of a triangle in the source file: the primitive of mesh object.source_mesh, and the triangle's number in this
 * primitive, counted as in the file (strips and fans, too). Its corners are those of the file, in the same order or
 * with the last two exchanged. */
struct kiln_triangle_source {
    uint32_t primitive, triangle;
};
/* Flag in `primitive`, added for a mesh with KILN_MESH_POSED: the last two corners are exchanged. */
#define KILN_SOURCE_TURNED 0x80000000u

struct kiln_source {
    uint32_t path; /* relative to the scene's folder */
    uint32_t reserved;
    uint64_t size;
    uint64_t hash[2]; /* XXH3-128 of the file's bytes */
};

enum kiln_note_severity {
    KILN_NOTE_INFORMATION = 0,
    KILN_NOTE_WARNING = 1,
    /* a warning that every bake prints again: it concerns what the user asked for, or shows in the light */
    KILN_NOTE_REPEATED = 2,
    /* information that every bake prints again: features of the file that no bake uses */
    KILN_NOTE_UNUSED = 3
};
static inline int kiln_note_warns(uint32_t severity)
{
    return severity == KILN_NOTE_WARNING || severity == KILN_NOTE_REPEATED;
}
struct kiln_note {
    uint32_t severity; /* enum kiln_note_severity */
    uint32_t text;
};

enum kiln_scene_units {
    KILN_SCENE_UNITS_UNKNOWN = 0,
    KILN_SCENE_UNITS_RADIOMETRIC = 1, /* stated by the file */
    KILN_SCENE_UNITS_PHOTOMETRIC = 2, /* stated by the file */
    KILN_SCENE_UNITS_BLENDER = 3      /* photometric, concluded from the exporter's name and the punctual lights */
};

struct kiln_scene_header {
    uint32_t magic, version;
    uint64_t size;            /* of the file, bytes */
    uint64_t content_hash[2]; /* XXH3-128 of all `size` bytes with this field zero (kiln_scene_content_hash) */
    uint64_t import_hash[2];  /* XXH3-128 of sources and import settings: the key of the import cache */
    /* m, world: origin of traced positions. It lies where the detail is, not in the middle of the bounds */
    double centre[3];
    double bounds_min[3], bounds_max[3]; /* m, world, of all objects */
    /* density by which lightmaps were sized; 0: they were sized otherwise */
    float texels_per_metre;
    /* Factor to enlarge the lightmaps' sides by, so that two texels lie between nearly all charts; 0: not needed; -1:
     * no factor is enough */
    float padding_factor;
    uint32_t units; /* enum kiln_scene_units: the unit of the lights' intensities */
    uint32_t reserved;
    /* the file has only the first kiln_scene_sections(version) sections; the others are empty in memory */
    struct {
        uint64_t offset, count;
    } sections[KILN_SECTION_COUNT];
};

/* The mapped file. All pointers are valid as long as the scene. */
struct kiln_scene {
    const struct kiln_scene_header *header;
    const char *strings;
    const struct kiln_material *materials;
    const struct kiln_texture *textures;
    const uint8_t *texels;
    const struct kiln_mesh *meshes;
    const struct kiln_object *objects;
    const struct kiln_light *lights;
    const struct kiln_camera *cameras;
    const struct kiln_environment *environment;
    const float *environment_texels;
    const struct kiln_vec3 *positions;
    const struct kiln_vec3 *normals;
    const struct kiln_vec2 *texcoord_base;
    const struct kiln_vec2 *texcoord_emission;
    const struct kiln_vec2 *texcoord_lightmap;
    const uint8_t *colors;
    const uint32_t *triangles;
    const uint32_t *triangle_materials;
    const struct kiln_source *sources;
    const struct kiln_note *notes;
    const struct kiln_triangle_source *triangle_sources; /* NULL: none */
    const struct kiln_normal_map *normal_maps;
    const struct kiln_vec2 *texcoord_normal; /* NULL: none */
    const struct kiln_gloss *glosses;
    const struct kiln_vec2 *texcoord_gloss;             /* NULL: none */
    const struct kiln_object_settings *object_settings; /* one an object, of a part; NULL: none */
    size_t material_count, texture_count, mesh_count, object_count, light_count, camera_count;
    size_t vertex_count, triangle_count; /* stored; instances not expanded */
    size_t source_count, note_count, normal_map_count, gloss_count;
    /* result of kiln_scene_take_gloss: gloss of each material, with `material` KILN_NONE if light transport treats it
     * as diffuse; NULL: all are diffuse. If set, `materials` are copies */
    struct kiln_gloss *taken;
    struct kiln_pane *panes; /* reflection of each material as a pane (kiln_surface_passage); NULL: no panes */
    struct kiln_material *own_materials; /* private */
    const void *mapped;                  /* the file */
    size_t mapped_bytes;
    struct kiln_scene_header own_header; /* private: what `header` points to */
    int descriptor;                      /* private */
    struct timespec modified;            /* private: the file's modification time when it was opened */
};

/* Element size of a section in bytes, and its name for messages. */
size_t kiln_scene_element_size(enum kiln_scene_section section);
const char *kiln_scene_section_name(enum kiln_scene_section section);

/* Number of sections, and size in bytes, of the header of a file of this version. */
static inline unsigned kiln_scene_sections(uint32_t version)
{
    return version == KILN_SCENE_VERSION_PLAIN         ? KILN_SECTION_NORMAL_MAPS
           : version == KILN_SCENE_VERSION_NORMAL_MAPS ? KILN_SECTION_GLOSS
           : version == KILN_SCENE_VERSION             ? KILN_SECTION_OBJECT_SETTINGS
                                                       : KILN_SECTION_COUNT;
}
static inline size_t kiln_scene_header_bytes(uint32_t version)
{
    return offsetof(struct kiln_scene_header, sections) +
           kiln_scene_sections(version) * sizeof((struct kiln_scene_header *)0)->sections[0];
}

/* Computes the content hash of a file: `header` is its header, `rest` its other bytes, [kiln_scene_header_bytes,
 * header->size). */
void kiln_scene_content_hash(const struct kiln_scene_header *header, const void *rest, uint64_t hash[2]);

/* Maps `path` and checks all of it: header, hash, bounds of every section, every index, every number finite. Not
 * collective. KILN_NO_INPUT, KILN_BAD_INPUT (not a scene file, damaged, other version), KILN_SYSTEM. Destroy with
 * kiln_scene_close. */
int kiln_scene_open(struct kiln_scene **scene, const char *path, struct kiln_error *error);
/* As kiln_scene_open, for an open file. The scene owns the descriptor from now on, even on failure. `path`: for error
 * sentences. */
int kiln_scene_open_descriptor(struct kiln_scene **scene, int descriptor, const char *path, struct kiln_error *error);
/* As kiln_scene_open_descriptor, for the scene file of a part; any other scene file is KILN_BAD_INPUT. The descriptor
 * is closed at once, so that thousands of parts can be open. */
int kiln_scene_open_part(struct kiln_scene **scene, int descriptor, const char *path, struct kiln_error *error);
void kiln_scene_close(struct kiln_scene **scene);
/* Returns KILN_IO if the file was written to since it was opened, so that data read from it may be wrong. `path` is
 * used in the sentence. */
int kiln_scene_check_unchanged(const struct kiln_scene *scene, const char *path, struct kiln_error *error);

static inline const char *kiln_scene_string(const struct kiln_scene *scene, uint32_t offset)
{
    return scene->strings + offset;
}

/* Number of bytes of an object's name that tell its part and place, PART or PART.2; 0: it is of no part. */
static inline size_t kiln_scene_place(const struct kiln_scene *scene, size_t object)
{
    const char *name = kiln_scene_string(scene, scene->objects[object].name), *slash = strchr(name, '/');
    return slash == NULL ? 0 : (size_t)(slash - name);
}

/* Index after the last of the objects that stand in the same part and place as object `first`; such stand together. */
static inline size_t kiln_scene_place_end(const struct kiln_scene *scene, size_t first)
{
    const char *name = kiln_scene_string(scene, scene->objects[first].name);
    const size_t length = kiln_scene_place(scene, first);
    size_t end = first + 1;
    while (end < scene->object_count && kiln_scene_place(scene, end) == length &&
           strncmp(kiln_scene_string(scene, scene->objects[end].name), name, length) == 0)
        end++;
    return end;
}

#endif
