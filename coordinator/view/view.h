/* Renderer of views: draws a picture of a bake with primary rays of a pinhole camera and shades surfaces from the
 * published lightmaps.
 *
 * The radiance of a pixel is the mean over a fixed grid of sub-pixel rays. A ray has base colour x E / pi + emission at
 * its first hit, or the environment if it leaves the scene. Sampling is adaptive: of 4 x 4 rays, 4 are traced first,
 * one in each row and column of the grid. The others follow only if the first rays of the pixel and its neighbours see
 * different things. They are only shaded, not traced, if the first rays of all nine pixels hit opaque triangles with
 * common corners, and those of the pixel hit one evenly lit triangle. Fields are always drawn with all rays, so that
 * they add up. E is read bilinearly from DIR/lightmaps/OBJECT.exr. If the material has a normal map and the lightmaps
 * were baked with --directional, E is for the mapped normal (formulas in normal_map.h). Lightmaps are loaded when first
 * needed and stay in memory, with 12 bytes per texel, plus 48 (sh1) or 16 (dominant) in a scene with normal maps.
 *
 * If materials are taken with their gloss (kiln_scene_take_gloss), mirrors, gloss and glass show their reflections and
 * refractions (view_gloss.h).
 *
 * Otherwise metals are shown as diffuse surfaces of their base colour, which is an approximation: they have no diffuse
 * reflection.
 * Single-sided surfaces are visible from their front only, as glTF defines: rays that hit their back continue. Rays
 * also pass through caster-only objects, which have no lightmap, unless these emit. The back of a double-sided surface
 * shows lightmaps/back/OBJECT.exr if that was baked, else the light of its front. The picture reports its fractions of
 * metals and of such backs.
 *
 * Not collective. Deterministic for one backend and instruction set; one process draws from published files, so the
 * number of ranks that baked them does not matter. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_H
#define KILN_COORDINATOR_VIEW_VIEW_H

#include <math.h>
#include <jansson.h>

#include "coordinator/field/field.h"
#include "coordinator/output/image.h"
#include "coordinator/output/read/results.h"
#include "coordinator/output/tone_map.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"

struct kiln_view_params;
struct kiln_view_filter;

/* Renderer of views that does not use lightmaps. `render` creates the image, with channels R G B (radiance) and, if
 * params have `spread`, its channels. With `side` 1 the image is only for metering the exposure and may be noisy. */
struct kiln_view_renderer {
    int (*render)(void *context, const struct kiln_view_params *params, struct kiln_image **image,
                  struct kiln_error *error);
    void *context;
};

/* The bake that is drawn. All pointers are borrowed. */
struct kiln_view_source {
    const char *directory; /* folder of the bake, from which lightmaps are read */
    /* results of this folder, if somebody else may have written it; NULL: this process has just written it */
    struct kiln_results *results;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_lights *lights; /* has the environment; NULL: black */
    struct kiln_backend *backend;
    bool texels; /* draw a checkerboard of the lightmaps' texels instead of light */
    /* a field of the lightmaps whose values are drawn instead of light, its first three components as red, green and
     * blue; NULL: light */
    const struct kiln_field *field;
    const struct kiln_voxels *voxels;          /* draws voxels (voxel_view.h); the field must be positions; NULL: no */
    bool nearest;                              /* texels as they are, not filtered bilinearly */
    bool no_normal_maps;                       /* draw materials as if they had no normal maps */
    struct kiln_view_maps *maps;               /* lightmaps for several pictures; NULL: each picture reads its own */
    const struct kiln_stop *stop;              /* may ask to stop (KILN_STOPPED); NULL: never */
    const struct kiln_view_renderer *renderer; /* NULL: lightmaps are drawn */
    void (*tell)(void *context, double share); /* fraction of the picture that is drawn; NULL: nobody asks */
    void *tell_context;
};

/* The lightmaps of a bake; each is read when it is first needed. */
struct kiln_view_maps;

/* Copies the source, with its borrowed pointers. With `coarse` > 0 each lightmap is averaged down to at most `coarse`
 * texels a side, which bounds the memory. */
int kiln_view_maps_create(struct kiln_view_maps **maps, const struct kiln_view_source *source, uint32_t coarse,
                          struct kiln_error *error);
void kiln_view_maps_destroy(struct kiln_view_maps **maps);

enum { KILN_VIEW_INSIDE_DEGREES = 55, KILN_VIEW_OUTSIDE_DEGREES = 45 }; /* vertical angles of automatic views */

struct kiln_view_camera {
    struct kiln_dvec3 position;           /* m, relative to the scene's centre */
    struct kiln_dvec3 right, up, forward; /* unit */
    double extent_x, extent_y;            /* half the picture's size at distance 1; in metres when orthographic */
    bool orthographic;
};

/* Request for a view. In every field, zero or NULL means the default. */
struct kiln_view_wish {
    const struct kiln_camera *camera; /* a camera of the scene; default: the first */
    /* positions of eye and target, world, m; `to` alone turns the camera, `from` alone looks at the middle of the scene
     */
    const double *from, *to;
    double field_of_view;            /* degrees, vertical; default: the camera's; else 45, or 55 from inside */
    uint32_t width, height;          /* pixels; default: 960, and the height by the aspect of the camera, or 4:3 */
    uint64_t most_pixels;            /* the default width is reduced until there are at most about so many pixels */
    bool surfaces;                   /* the image has the channels of view_surfaces.h too */
    struct kiln_view_filter *filter; /* filters the rendered picture (view_filter.h); borrowed; NULL: none */
};

/* Choice of the viewpoint: a camera of the scene, the request, or automatic from inside or outside. A picture of a
 * lightmap itself (atlas) has no viewpoint. */
enum kiln_view_kind { KILN_VIEW_CAMERA, KILN_VIEW_GIVEN, KILN_VIEW_INSIDE, KILN_VIEW_OUTSIDE, KILN_VIEW_ATLAS };

struct kiln_viewpoint {
    enum kiln_view_kind kind;
    const char *camera;    /* name of the camera, or of the object (atlas); borrowed from the scene; else NULL */
    double from[3], to[3]; /* world, m */
};

/* Finds a camera of the scene by name. KILN_USAGE if there is none; the message lists the cameras of the scene. */
int kiln_view_find_camera(const struct kiln_scene *scene, const char *name, const struct kiln_camera **camera,
                          struct kiln_error *error);

/* Chooses camera and size. If the scene has no camera and none is requested, the view is from inside if the scene is
 * closed (view_seek.h), else from outside with all of the scene in the picture. KILN_USAGE if eye and target coincide;
 * also the statuses of reading lightmaps. */
int kiln_view_aim(const struct kiln_view_source *source, const struct kiln_view_wish *wish,
                  struct kiln_view_camera *camera, uint32_t *width, uint32_t *height, struct kiln_viewpoint *viewpoint,
                  struct kiln_error *error);

struct kiln_view_params {
    struct kiln_view_source source;
    struct kiln_view_camera camera;
    uint32_t width, height;
    uint32_t side; /* side x side rays for each pixel, 1 or more */
    /* For path tracing. frame: number of earlier pictures of this kind; this one uses the paths after theirs. spread:
     * with more than one path per pixel, also make channels spread.R G B: the mean over half of the paths minus the
     * mean over all, scaled so that its variance is that of R G B. */
    uint32_t frame;
    bool spread;
};

/* Computes the ray through (x, y) of the picture, in pixels from its upper left corner: origin and unit direction. */
void kiln_view_ray(const struct kiln_view_params *params, double x, double y, struct kiln_vec3 *origin,
                   struct kiln_vec3 *direction);

/* Fractions of the picture, 0 to 1, that are approximate. */
struct kiln_view_approximate {
    double metal;       /* metals, shown as diffuse surfaces */
    double front_light; /* backs, shown with the light of their fronts */
    double flat;        /* materials with a normal map, shown without it: the lightmaps lack the directions of light */
    double mapped;      /* materials with a normal map, shown with it */
};

/* Renders an image with channels R G B, radiance. KILN_BAD_INPUT if a lightmap does not belong to the scene,
 * KILN_NO_INPUT if it is missing. */
int kiln_view_render(const struct kiln_view_params *params, struct kiln_image **image,
                     struct kiln_view_approximate *approximate, struct kiln_error *error);

/* Source of the exposure: the picture, all frames of a path, an earlier picture, or none. */
enum kiln_metering { KILN_METERED_PICTURE, KILN_METERED_PATH, KILN_METERED_BEFORE, KILN_METERED_NOTHING };

/* Colour key, for pictures whose colours neither exposure nor range explains: pairs of colours, each with a word shown
 * below it, and a sentence. */
enum { KILN_KEY_PAIRS = 4 };
struct kiln_color_key {
    int pairs;
    struct {
        float rgb[2][3];
        char text[32];
    } of[KILN_KEY_PAIRS];
    char note[200];
};

/* A rendered picture with its viewpoint and exposure. */
struct kiln_picture {
    struct kiln_image *image; /* radiance */
    struct kiln_viewpoint viewpoint;
    /* the picture shows radiance x exposure.scale x 2^(requested stops); scale is 1 unless the meaning is
     * KILN_FIELD_AMOUNT */
    struct kiln_exposure exposure;
    enum kiln_metering metering;
    enum kiln_field_meaning meaning;  /* meaning of the pixel values */
    const struct kiln_color_key *key; /* of KILN_FIELD_COLOR; borrowed; NULL: colours as they are */
    const char *note;                 /* additional sentence about the picture, borrowed; NULL: none */
    const char *unit;                 /* unit of the values, borrowed; for meanings with a range: */
    double low[3], high[3];           /* ends of the colour range, for R, G, B (false_color.h) */
    struct kiln_view_approximate approximate;
};

/* User's settings of exposure and tone curve. */
struct kiln_look {
    enum kiln_tone_curve curve;
    double stops;                     /* powers of two on the exposure */
    bool no_metering;                 /* no automatic exposure: kiln_plain_exposure */
    const struct kiln_exposure *kept; /* replaces the automatic exposure; borrowed; NULL: none */
};

/* Settings kept from an earlier picture, so that the same scene in other light can be compared with it: its look, and
 * its viewpoint if that was found automatically. Do not copy the struct: `look` points into it. */
struct kiln_kept_picture {
    struct kiln_look look;
    struct kiln_exposure exposure;
    bool found, inside;
    double from[3], to[3]; /* world, m */
};
/* Reads the settings from JSON of kiln_picture_json; false: it describes no picture of light. */
bool kiln_picture_keep(const json_t *preview, struct kiln_kept_picture *kept);
void kiln_picture_keep_place(const struct kiln_kept_picture *kept, struct kiln_view_wish *wish);

/* Chooses the camera and renders, with `side` x `side` rays for each pixel. Receiver-only objects are visible too: if
 * rays pass through them in the source's geometry, a BVH with them is built for the picture. Release with
 * kiln_image_destroy(&picture->image). Of the look only `no_metering` matters. */
int kiln_picture_make(const struct kiln_view_source *source, const struct kiln_view_wish *wish, uint32_t side,
                      const struct kiln_look *look, struct kiln_picture *picture, struct kiln_error *error);

/* Sets the meaning of a picture's image, and the exposure or the range of its colours. */
int kiln_picture_fit(const struct kiln_view_source *source, const struct kiln_look *look, struct kiln_picture *picture,
                     struct kiln_error *error);

/* Draws an object's lightmap itself instead of a view: light (as irradiance) or the source's field. A texel is a square
 * of at least one pixel, such that the longer side has `side` pixels (0: 512) or a little less. Texels are filtered as
 * the source says. Texels without a value are NaN if colours have a range, else 0. KILN_USAGE if the object has no
 * lightmap, with a list of those that exist. */
int kiln_atlas_make(const struct kiln_view_source *source, const char *object, uint32_t side,
                    const struct kiln_look *look, struct kiln_picture *picture, struct kiln_error *error);

/* Automatic exposure for several views together, such as the frames of a path, which must not flicker:
 * kiln_auto_exposure of all their pictures together, or of 48 spread over them, each of 96 x 72 rays. */
int kiln_view_meter(const struct kiln_view_source *source, const struct kiln_view_wish *wishes, size_t count,
                    struct kiln_exposure *exposure, struct kiln_error *error);

enum { KILN_VIEWPOINT_TEXT = 640, KILN_PICTURE_TEXT = 1024 };

/* Describes the viewpoint: "seen from inside, at 1.2,1.5,0.3 towards 0.1,1.2,-3 (...)". */
void kiln_viewpoint_text(const struct kiln_viewpoint *viewpoint, char text[KILN_VIEWPOINT_TEXT]);

/* Describes exposure, tone curve and approximations, one sentence on each line. */
void kiln_picture_notes(const struct kiln_picture *picture, const struct kiln_look *look, char text[KILN_PICTURE_TEXT]);

/* Describes the picture as JSON: {"viewpoint": {"chosen": "camera" | "given" | "inside" | "outside" | "atlas",
 * "camera", "from", "to"}, "exposure": {"automatic", "added"} in stops and "white", "tone_map" (if there is one),
 * "metal_share", "front_light_share"}, and if colours have a range "scale": {"low", "high", "unit"}. */
json_t *kiln_picture_json(const struct kiln_picture *picture, const struct kiln_look *look);

/* Publishes the picture, tone-mapped unless its meaning says otherwise, at the destination (publish.h), with its
 * viewpoint and notes as PNG Description. */
int kiln_picture_write(const char *directory, const char *name, const struct kiln_picture *picture,
                       const struct kiln_look *look, struct kiln_error *error);

/* Index of the axis direction nearest to a normal: +x, -x, +y, -y, +z, -z. */
static inline uint32_t kiln_view_side(struct kiln_vec3 normal)
{
    const float x = fabsf(normal.x), y = fabsf(normal.y), z = fabsf(normal.z);
    if (x >= y && x >= z)
        return normal.x > 0.0f ? 0 : 1;
    if (y >= z)
        return normal.y > 0.0f ? 2 : 3;
    return normal.z > 0.0f ? 4 : 5;
}

#endif
