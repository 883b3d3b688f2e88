/* A picture of a bake: primary rays through a pinhole, surfaces shaded from the published lightmaps.
 *
 * Radiance of a pixel is the mean over a fixed grid of sub-pixel rays of base colour x E / pi + emission at the first
 * hit, E looked up bilinearly in DIR/lightmaps/OBJECT.exr (read when first needed; all lightmaps in view stay in
 * memory, 12 bytes a texel), and the environment where a ray leaves the scene. A metal reflects nothing diffusely; it
 * is shown like a diffuse surface of its base colour, which is approximate, and the picture says how much of it is.
 * Single-sided surfaces are seen from the front only, as glTF has it: a ray that meets one from behind goes on. So it
 * does through caster-only objects, which have no lightmap, unless they emit. The back of a double-sided one shows
 * lightmaps/back/OBJECT.exr where that was baked, else its front's light, and the picture says how much of it is that.
 * Not collective; deterministic for one backend and instruction set: one process draws from published files, so the
 * number of ranks that baked them does not matter. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_H
#define KILN_COORDINATOR_VIEW_VIEW_H

#include <jansson.h>

#include "coordinator/output/image.h"
#include "coordinator/output/read/results.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"

/* What is looked at. All borrowed. */
struct kiln_view_source {
    const char *directory; /* of the bake: lightmaps are read from it */
    /* the same folder, when somebody else may have written it; NULL: this process has just done so */
    struct kiln_results *results;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_lights *lights; /* for the environment; NULL: black */
    struct kiln_backend *backend;
    bool texels;                  /* a checkerboard of the lightmaps' texels in the place of light */
    const struct kiln_stop *stop; /* borrowed; NULL: none. KILN_STOPPED then */
};

struct kiln_view_camera {
    struct kiln_dvec3 position;           /* m, relative to the scene's centre */
    struct kiln_dvec3 right, up, forward; /* unit */
    double extent_x, extent_y;            /* half the picture's size at distance 1; in metres when orthographic */
    bool orthographic;
};

/* What is asked for; zero or NULL means default in every field. */
struct kiln_view_wish {
    const char *camera; /* name of a camera of the scene; default: the first */
    /* world, m: eye and target; to alone turns the camera, from alone looks at the scene's middle */
    const double *from, *to;
    double field_of_view;   /* degrees, vertical; default: the camera's, or 45, or from inside 55 */
    uint32_t width, height; /* pixels; default 960 and what the camera's aspect (or 4:3) makes of it */
};

/* How a viewpoint came about. */
enum kiln_view_kind { KILN_VIEW_CAMERA, KILN_VIEW_GIVEN, KILN_VIEW_INSIDE, KILN_VIEW_OUTSIDE };

struct kiln_viewpoint {
    enum kiln_view_kind kind;
    const char *camera;    /* KILN_VIEW_CAMERA: its name, borrowed from the scene; else NULL */
    double from[3], to[3]; /* world, m */
};

/* Decides camera and size. A scene without a camera, of which nothing is asked, is looked at from inside when it is
 * closed (view_seek.h), else from outside so that all of it is in the picture. KILN_USAGE when there is no camera of
 * that name (the sentence lists those there are), or when eye and target coincide; and the statuses of reading
 * lightmaps. */
int kiln_view_aim(const struct kiln_view_source *source, const struct kiln_view_wish *wish,
                  struct kiln_view_camera *camera, uint32_t *width, uint32_t *height, struct kiln_viewpoint *viewpoint,
                  struct kiln_error *error);

struct kiln_view_params {
    struct kiln_view_source source;
    struct kiln_view_camera camera;
    uint32_t width, height;
    uint32_t side; /* side x side rays a pixel; 0: 3 */
};

/* Shares of the picture, 0..1, that are approximate. */
struct kiln_view_shares {
    double metal; /* metals, in the light of diffuse surfaces */
    double lent;  /* backs, in the light of their fronts */
};

/* Renders channels R G B, radiance. KILN_BAD_INPUT or KILN_NO_INPUT when a lightmap does not belong to the scene or is
 * missing. */
int kiln_view_render(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_view_shares *shares,
                     struct kiln_error *error);

/* A picture and what there is to say of it. */
struct kiln_picture {
    struct kiln_image *image; /* radiance */
    struct kiln_viewpoint viewpoint;
    double exposure; /* automatic, stops: the picture shows radiance x 2^(exposure + stops asked for) */
    struct kiln_view_shares shares;
};

/* Aims and renders, `side` x `side` rays a pixel. Receiver-only objects are in the picture, also when the source's
 * geometry has no ray meet them: then a tree is built for the picture alone. Release with
 * kiln_image_destroy(&picture->image). */
int kiln_picture_make(const struct kiln_view_source *source, const struct kiln_view_wish *wish, uint32_t side,
                      struct kiln_picture *picture, struct kiln_error *error);

enum { KILN_VIEWPOINT_TEXT = 640, KILN_PICTURE_TEXT = 1024 };

/* In words: "seen from inside, at 1.2,1.5,0.3 towards 0.1,1.2,-3 (...)". */
void kiln_viewpoint_text(const struct kiln_viewpoint *viewpoint, char text[KILN_VIEWPOINT_TEXT]);

/* The same with exposure (`stops` was added to it) and metals: one sentence a line. */
void kiln_picture_text(const struct kiln_picture *picture, double stops, char text[KILN_PICTURE_TEXT]);

/* The same as JSON: {"viewpoint": {"chosen": "camera" | "given" | "inside" | "outside", "camera", "from", "to"},
 * "exposure": {"automatic", "added"} in stops, "metal_share", "lent_share"}. */
json_t *kiln_picture_json(const struct kiln_picture *picture, double stops);

/* Publishes the tone-mapped picture at a place (publish.h) with that text in it (PNG's Description). */
int kiln_picture_write(const char *directory, const char *name, const struct kiln_picture *picture, double stops,
                       struct kiln_error *error);

#endif
