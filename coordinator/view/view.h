/* Renderer of views: draws a picture of a bake with primary rays of a pinhole camera and shades surfaces from the
 * published lightmaps.
 *
 * The radiance of a pixel is the mean over a fixed grid of sub-pixel rays of base colour x E / pi + emission at the
 * first hit, or of the environment where a ray leaves the scene. Of 4 x 4 rays 4 come first, one in each row and column
 * of the grid. They suffice where they, and those of the pixels around, see much the same; else the others follow.
 * These are not traced, only shaded, where all first rays of the nine pixels meet opaque triangles with corners in
 * common, those of the pixel one triangle in even light. Fields that are shown have all rays, so that they add up. E is
 * read bilinearly from DIR/lightmaps/OBJECT.exr. Where the material has a normal map and the lightmaps were baked with
 * --directional, E is that of the mapped normal: normal_map.h has the formulas. Lightmaps are loaded when first needed
 * and all stay in memory, 12 bytes for each texel, and 48 (sh1) or 16 (dominant) more in a scene that has normal maps.
 *
 * Where materials are taken with their gloss (kiln_scene_take_gloss), pixels with mirrors, gloss or glass in them show
 * what these mirror and let through (view_gloss.h).
 *
 * Otherwise metals reflect nothing diffusely; they are shown as diffuse surfaces of their base colour, which is an
 * approximation.
 * Single-sided surfaces are visible from their front only, as glTF defines: rays that hit their back continue. Rays
 * also pass through caster-only objects, which have no lightmap, unless these emit. The back of a double-sided surface
 * shows lightmaps/back/OBJECT.exr if that was baked, else the light of its front. The picture reports how much of it
 * shows metals and how much such backs.
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

/* Renderer of views by other means than lightmaps. `render` creates the image, with channels R G B, radiance, and those
 * that `spread` asks for; with `side` 1 it is for an exposure, and may be noisy. */
struct kiln_view_renderer {
    int (*render)(void *context, const struct kiln_view_params *params, struct kiln_image **image,
                  struct kiln_error *error);
    void *context;
};

/* The bake that is drawn. All pointers are borrowed. */
struct kiln_view_source {
    const char *directory; /* folder of the bake, from which lightmaps are read */
    /* the same folder, if somebody else may have written it; NULL: this process has just written it */
    struct kiln_results *results;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_lights *lights; /* has the environment; NULL: black */
    struct kiln_backend *backend;
    bool texels; /* draw a checkerboard of the lightmaps' texels instead of light */
    /* a field of the lightmaps whose values are drawn instead of light, its first three components as red, green and
     * blue; NULL: light */
    const struct kiln_field *field;
    const struct kiln_voxels *voxels; /* the field is places: their voxels are drawn (voxel_view.h); NULL: none are */
    bool nearest;                     /* texels as they are, not filtered bilinearly */
    bool no_normal_maps;              /* draw materials as if they had no normal maps */
    struct kiln_view_maps *maps;      /* lightmaps for several pictures; NULL: each picture reads its own */
    const struct kiln_stop *stop;     /* may ask to stop (KILN_STOPPED); NULL: never */
    const struct kiln_view_renderer *renderer; /* NULL: lightmaps are drawn */
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

/* The requested view. In every field, zero or NULL means the default. */
struct kiln_view_wish {
    const struct kiln_camera *camera; /* a camera of the scene; default: the first */
    /* positions of eye and target, world, m; `to` alone turns the camera, `from` alone looks at the middle of the scene
     */
    const double *from, *to;
    double field_of_view;            /* degrees, vertical; default: the camera's; else 45, or 55 from inside */
    uint32_t width, height;          /* pixels; default: 960, and the height by the aspect of the camera, or 4:3 */
    uint64_t most_pixels;            /* the default width is so much less that there are at most so many, about */
    bool surfaces;                   /* the image has the channels of view_surfaces.h too */
    struct kiln_view_filter *filter; /* what the renderer draws goes through it (view_filter.h); borrowed; NULL: none */
};

/* How the viewpoint was chosen: a camera of the scene, the request, or automatically from inside or outside; there is
 * none of a lightmap itself. */
enum kiln_view_kind { KILN_VIEW_CAMERA, KILN_VIEW_GIVEN, KILN_VIEW_INSIDE, KILN_VIEW_OUTSIDE, KILN_VIEW_ATLAS };

struct kiln_viewpoint {
    enum kiln_view_kind kind;
    const char *camera;    /* its name, or KILN_VIEW_ATLAS: the object's; borrowed from the scene; else NULL */
    double from[3], to[3]; /* world, m */
};

/* Finds a camera of the scene. KILN_USAGE if there is none of that name; the message lists those that are there. */
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
    /* For renderers that trace paths: the picture has those after the paths of so many pictures like it; and it has
     * channels spread.R G B where it has more than one path a pixel: of the mean over half the paths how far it is
     * from that over all, scaled so that the variance is that of R G B. */
    uint32_t frame;
    bool spread;
};

/* The ray through a place of the picture, in pixels from its upper left corner: origin and unit direction. */
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

/* How an exposure was chosen: from the picture, from all frames of a path, by a picture before, or not at all. */
enum kiln_metering { KILN_METERED_PICTURE, KILN_METERED_PATH, KILN_METERED_BEFORE, KILN_METERED_NOTHING };

/* Key to colours where neither exposure nor range explains them: pairs of colours, with a word each that stands under
 * them, and a sentence. */
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
    /* the picture shows radiance x exposure.scale x 2^(requested stops); scale 1 where the meaning is another than
     * KILN_FIELD_AMOUNT, which has a scale of its own */
    struct kiln_exposure exposure;
    enum kiln_metering metering;
    enum kiln_field_meaning meaning;  /* of what is shown */
    const struct kiln_color_key *key; /* of KILN_FIELD_COLOR; borrowed; NULL: colours as they are */
    const char *note;                 /* one more sentence about it, borrowed; NULL: none */
    const char *unit;                 /* of what is shown, borrowed; of meanings that name a range: */
    double low[3], high[3];           /* values whose colours are the first and the last, of R, G, B (false_color.h) */
    struct kiln_view_approximate approximate;
};

/* Wishes of a user for the looks of a picture. */
struct kiln_look {
    enum kiln_tone_curve curve;
    double stops;                     /* powers of two on the exposure */
    bool no_metering;                 /* no automatic exposure: kiln_plain_exposure */
    const struct kiln_exposure *kept; /* the exposure, in the place of an automatic one; borrowed; NULL: none */
};

/* Data of a picture before: its looks, and the place it was seen from if that was found automatically, so that the same
 * scene in other light can be compared with it. Its look points into it: do not copy it. */
struct kiln_kept_picture {
    struct kiln_look look;
    struct kiln_exposure exposure;
    bool found, inside;
    double from[3], to[3]; /* world, m */
};
/* Reads what kiln_picture_json has written; false: there is no picture of light. */
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

/* Draws an object's lightmap in the place of a view: what the source shows, a texel as a square of pixels, of as many
 * that the longer side has `side` pixels (0: 512) or a little less, and one at least; between texels as the source
 * filters. Light is irradiance. Texels without a value are NaN where colours have a range, else 0. KILN_USAGE if there
 * is no lightmap of that object, with a list of those that there are. */
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

/* The same as JSON: {"viewpoint": {"chosen": "camera" | "given" | "inside" | "outside" | "atlas", "camera", "from",
 * "to"}, "exposure": {"automatic", "added"} in stops and "white", "tone_map" (where there is one), "metal_share",
 * "front_light_share"}, and where colours have a range "scale": {"low", "high", "unit"}. */
json_t *kiln_picture_json(const struct kiln_picture *picture, const struct kiln_look *look);

/* Publishes the picture, tone-mapped unless its meaning says otherwise, at the destination (publish.h), with its
 * viewpoint and notes as PNG Description. */
int kiln_picture_write(const char *directory, const char *name, const struct kiln_picture *picture,
                       const struct kiln_look *look, struct kiln_error *error);

/* The side of a box along the axes, of six, that a surface with this normal faces: +x, -x, +y, -y, +z, -z. */
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
