#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/view/view_seek.h"

enum { OUTSIDE = 8 }; /* number of candidate cameras outside the scene */

static const double half_degree = KILN_PI / 360.0;

static struct kiln_dvec3 from_floats(const float v[3]) { return dvec3((double)v[0], (double)v[1], (double)v[2]); }

static struct kiln_dvec3 unit(struct kiln_dvec3 v) { return dvec3_scale(v, 1.0 / dvec3_length(v)); }

static struct kiln_dvec3 relative(const struct kiln_scene *scene, const double world[3])
{
    const double *centre = scene->header->centre;
    return dvec3(world[0] - centre[0], world[1] - centre[1], world[2] - centre[2]);
}

void kiln_view_look(struct kiln_view_camera *camera, struct kiln_dvec3 forward)
{
    const struct kiln_dvec3 up =
        fabs(forward.y) > 0.999 ? dvec3(0.0, 0.0, forward.y > 0.0 ? 1.0 : -1.0) : dvec3(0.0, 1.0, 0.0);
    camera->forward = forward;
    camera->right = unit(dvec3_cross(forward, up));
    camera->up = dvec3_cross(camera->right, forward);
}

/* Places the camera slightly above the scene, as close as possible with all corners of the scene's box in the picture.
 * Returns its distance from the middle. `turn`: 0 is in front, a little to the right; each step is 1 / OUTSIDE of a
 * circle around the scene. */
static double frame_all(const struct kiln_scene *scene, int turn, struct kiln_view_camera *camera)
{
    const struct kiln_scene_header *h = scene->header;
    const double middle[3] = {0.5 * (h->bounds_min[0] + h->bounds_max[0]), 0.5 * (h->bounds_min[1] + h->bounds_max[1]),
                              0.5 * (h->bounds_min[2] + h->bounds_max[2])};
    const double phi = atan(0.28) + 2.0 * KILN_PI * turn / OUTSIDE;
    const struct kiln_dvec3 away = unit(dvec3(sin(phi), 0.22, cos(phi))),
                            half = dvec3(h->bounds_max[0] - middle[0], h->bounds_max[1] - middle[1],
                                         h->bounds_max[2] - middle[2]);
    double distance = 1e-30;
    kiln_view_look(camera, dvec3_scale(away, -1.0));
    for (int k = 0; k < 8; k++) {
        const struct kiln_dvec3 corner =
            dvec3(k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z);
        const double aside = fabs(dvec3_dot(corner, camera->right)) / camera->extent_x,
                     above = fabs(dvec3_dot(corner, camera->up)) / camera->extent_y;
        distance = fmax(distance, 1.05 * fmax(aside, above) + dvec3_dot(corner, away));
    }
    camera->position = dvec3_add(relative(scene, middle), dvec3_scale(away, distance));
    return distance;
}

static int no_such_camera(const struct kiln_scene *scene, const char *name, struct kiln_error *error)
{
    char names[1024] = "";
    for (size_t i = 0; i < scene->camera_count && strlen(names) + 1 < sizeof names; i++)
        (void)snprintf(names + strlen(names), sizeof names - strlen(names), "%s'%s'", i == 0 ? "" : ", ",
                       kiln_scene_string(scene, scene->cameras[i].name));
    return kiln_fail(error, KILN_USAGE, "the scene has no camera '%s'; it has %s", name,
                     scene->camera_count == 0 ? "none" : names);
}

int kiln_view_find_camera(const struct kiln_scene *scene, const char *name, const struct kiln_camera **found,
                          struct kiln_error *error)
{
    for (size_t i = 0; i < scene->camera_count; i++)
        if (strcmp(kiln_scene_string(scene, scene->cameras[i].name), name) == 0) {
            *found = &scene->cameras[i];
            return KILN_OK;
        }
    return no_such_camera(scene, name, error);
}

enum { DEFAULT_WIDTH = 960 };

static void choose_size(const struct kiln_view_wish *wish, double aspect, uint32_t *width, uint32_t *height)
{
    *width = wish->width;
    *height = wish->height;
    if (*width == 0 && *height == 0 && wish->most_pixels > 0)
        *width = (uint32_t)fmax(1.0, fmin(DEFAULT_WIDTH, floor(sqrt((double)wish->most_pixels * aspect))));
    if (*width == 0)
        *width = *height == 0 ? DEFAULT_WIDTH : (uint32_t)fmax(1.0, round(*height * aspect));
    if (*height == 0)
        *height = (uint32_t)fmax(1.0, round(*width / aspect));
}

static double degrees_to_extent(double degrees) { return tan(degrees * half_degree); }

/* Takes position and direction of a camera of the scene, and its field of view unless the request has one. */
static void take_camera(const struct kiln_scene *scene, const struct kiln_camera *source,
                        struct kiln_view_camera *camera)
{
    camera->position = relative(scene, source->position);
    camera->right = from_floats(source->right);
    camera->up = from_floats(source->up);
    camera->forward = from_floats(source->forward);
}

/* Chooses position and direction automatically. */
static int find_place(const struct kiln_view_source *source, const struct kiln_view_wish *wish,
                      struct kiln_view_camera *camera, double aspect, struct kiln_viewpoint *viewpoint,
                      double *distance, struct kiln_error *error)
{
    struct kiln_view_camera inside = *camera, outside[OUTSIDE];
    double distances[OUTSIDE], reach = 0.0;
    bool found = false;
    size_t best = 0;
    for (int k = 0; k < OUTSIDE; k++) {
        outside[k] = *camera;
        distances[k] = frame_all(source->scene, k, &outside[k]);
    }
    viewpoint->kind = KILN_VIEW_OUTSIDE;
    inside.extent_y = degrees_to_extent(wish->field_of_view > 0.0 ? wish->field_of_view : KILN_VIEW_INSIDE_DEGREES);
    inside.extent_x = inside.extent_y * aspect;
    const int status =
        wish->to != NULL ? KILN_OK : kiln_view_seek(source, outside, OUTSIDE, &inside, &found, &best, &reach, error);
    *camera = found ? inside : outside[best];
    *distance = found ? reach : distances[best];
    if (found)
        viewpoint->kind = KILN_VIEW_INSIDE;
    return status;
}

/* Records the world positions of eye and target, for messages. */
static void note_places(const struct kiln_scene *scene, const struct kiln_view_camera *camera, double distance,
                        struct kiln_viewpoint *viewpoint)
{
    const struct kiln_dvec3 to = dvec3_add(camera->position, dvec3_scale(camera->forward, distance));
    const double from[3] = {camera->position.x, camera->position.y, camera->position.z}, target[3] = {to.x, to.y, to.z};
    for (int c = 0; c < 3; c++) {
        viewpoint->from[c] = from[c] + scene->header->centre[c];
        viewpoint->to[c] = target[c] + scene->header->centre[c];
    }
}

/* Applies the requested eye and target, which override any other camera. */
static int turn(const struct kiln_scene *scene, const struct kiln_view_wish *wish, struct kiln_view_camera *camera,
                double *distance, struct kiln_error *error)
{
    const struct kiln_dvec3 target = wish->to != NULL ? relative(scene, wish->to) : dvec3(0.0, 0.0, 0.0);
    const struct kiln_dvec3 way = dvec3_sub(target, camera->position);
    *distance = dvec3_length(way);
    if (!(*distance > 0.0))
        return kiln_fail(error, KILN_USAGE, "the eye and its target are the same point: --from and --to must differ");
    kiln_view_look(camera, unit(way));
    return KILN_OK;
}

/* Checks that the position is not too large: its square, which tracers compute, must fit a float. */
static int check_place(const struct kiln_view_camera *camera, struct kiln_error *error)
{
    const double most = 1e18, place[3] = {camera->position.x, camera->position.y, camera->position.z};
    for (int axis = 0; axis < 3; axis++)
        if (!(fabs(place[axis]) <= most))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "the eye is %g m from the scene's centre along %c, and at most %g m are possible: move "
                             "--from closer to the scene",
                             place[axis], "xyz"[axis], most);
    return KILN_OK;
}

int kiln_view_aim(const struct kiln_view_source *source, const struct kiln_view_wish *wish,
                  struct kiln_view_camera *camera, uint32_t *width, uint32_t *height, struct kiln_viewpoint *viewpoint,
                  struct kiln_error *error)
{
    const struct kiln_scene *scene = source->scene;
    const struct kiln_camera *first = scene->camera_count > 0 ? &scene->cameras[0] : NULL,
                             *own = wish->from != NULL     ? NULL
                                    : wish->camera != NULL ? wish->camera
                                                           : first;
    double distance = 1.0;
    int status = KILN_OK;
    *camera = (struct kiln_view_camera){.extent_y = degrees_to_extent(KILN_VIEW_OUTSIDE_DEGREES)};
    *viewpoint = (struct kiln_viewpoint){.kind = KILN_VIEW_GIVEN};
    if (own != NULL) {
        camera->orthographic = own->orthographic != 0;
        camera->extent_y = camera->orthographic ? (double)own->extent_y : tan(0.5 * (double)own->extent_y);
    }
    if (wish->field_of_view > 0.0) {
        camera->orthographic = false;
        camera->extent_y = degrees_to_extent(wish->field_of_view);
    }
    choose_size(wish, own != NULL && own->aspect > 0.0f ? (double)own->aspect : 4.0 / 3.0, width, height);
    const double aspect = (double)*width / (double)*height;
    camera->extent_x = camera->extent_y * aspect;
    if (wish->from != NULL) {
        camera->position = relative(scene, wish->from);
    } else if (own != NULL) {
        take_camera(scene, own, camera);
        viewpoint->kind = KILN_VIEW_CAMERA;
        viewpoint->camera = kiln_scene_string(scene, own->name);
    } else {
        KILN_TRY(find_place(source, wish, camera, aspect, viewpoint, &distance, error));
    }
    if (wish->from != NULL || wish->to != NULL) {
        viewpoint->kind = KILN_VIEW_GIVEN;
        KILN_TRY(turn(scene, wish, camera, &distance, error));
    }
    KILN_TRY(check_place(camera, error));
end:
    note_places(scene, camera, distance, viewpoint);
    return status;
}
