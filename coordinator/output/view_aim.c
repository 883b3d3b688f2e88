#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/output/view.h"

static const double half_degree = KILN_PI / 360.0;

static struct kiln_dvec3 from_floats(const float v[3]) { return dvec3((double)v[0], (double)v[1], (double)v[2]); }

static struct kiln_dvec3 unit(struct kiln_dvec3 v) { return dvec3_scale(v, 1.0 / dvec3_length(v)); }

static struct kiln_dvec3 relative(const struct kiln_scene *scene, const double world[3])
{
    const double *centre = scene->header->centre;
    return dvec3(world[0] - centre[0], world[1] - centre[1], world[2] - centre[2]);
}

/* y is up, unless that is where we look. */
static void look(struct kiln_view_camera *camera, struct kiln_dvec3 forward)
{
    const struct kiln_dvec3 up = fabs(forward.y) > 0.999 ? dvec3(0.0, 0.0, forward.y > 0.0 ? 1.0 : -1.0) : dvec3(0.0, 1.0, 0.0);
    camera->forward = forward;
    camera->right = unit(dvec3_cross(forward, up));
    camera->up = dvec3_cross(camera->right, forward);
}

/* From in front, a little to the right and above, so that the sphere around the scene fits both ways. */
static void frame_all(const struct kiln_scene *scene, struct kiln_view_camera *camera, double aspect)
{
    const struct kiln_scene_header *h = scene->header;
    const double middle[3] = {0.5 * (h->bounds_min[0] + h->bounds_max[0]), 0.5 * (h->bounds_min[1] + h->bounds_max[1]),
                              0.5 * (h->bounds_min[2] + h->bounds_max[2])};
    const struct kiln_dvec3 size = dvec3(h->bounds_max[0] - h->bounds_min[0], h->bounds_max[1] - h->bounds_min[1],
                                         h->bounds_max[2] - h->bounds_min[2]);
    const double radius = fmax(0.5 * dvec3_length(size), 1e-30);
    const double narrow = atan(camera->extent_y * fmin(1.0, aspect));
    const struct kiln_dvec3 away = unit(dvec3(0.28, 0.22, 1.0));
    camera->position = dvec3_add(relative(scene, middle), dvec3_scale(away, radius / sin(narrow)));
    look(camera, dvec3_scale(away, -1.0));
}

static int no_such_camera(const struct kiln_scene *scene, const char *name, struct kiln_error *error)
{
    char names[1024] = "";
    for (size_t i = 0; i < scene->camera_count && strlen(names) + 1 < sizeof names; i++)
        (void)snprintf(names + strlen(names), sizeof names - strlen(names), "%s'%s'", i == 0 ? "" : ", ",
                       kiln_scene_string(scene, scene->cameras[i].name));
    return kiln_fail(error, KILN_USAGE, "the scene has no camera '%s'; it has %s", name, scene->camera_count == 0 ? "none" : names);
}

static int find_camera(const struct kiln_scene *scene, const char *name, const struct kiln_camera **found, struct kiln_error *error)
{
    *found = scene->camera_count > 0 ? &scene->cameras[0] : NULL;
    if (name == NULL)
        return KILN_OK;
    for (size_t i = 0; i < scene->camera_count; i++)
        if (strcmp(kiln_scene_string(scene, scene->cameras[i].name), name) == 0) {
            *found = &scene->cameras[i];
            return KILN_OK;
        }
    return no_such_camera(scene, name, error);
}

static void choose_size(const struct kiln_view_wish *wish, double aspect, uint32_t *width, uint32_t *height)
{
    *width = wish->width;
    *height = wish->height;
    if (*width == 0)
        *width = *height == 0 ? 960 : (uint32_t)fmax(1.0, round(*height * aspect));
    if (*height == 0)
        *height = (uint32_t)fmax(1.0, round(*width / aspect));
}

int kiln_view_aim(const struct kiln_scene *scene, const struct kiln_view_wish *wish, struct kiln_view_camera *camera, uint32_t *width,
                  uint32_t *height, struct kiln_error *error)
{
    const struct kiln_camera *source = NULL;
    const int status = find_camera(scene, wish->camera, &source, error);
    if (status != KILN_OK)
        return status;
    *camera = (struct kiln_view_camera){.extent_y = tan(45.0 * half_degree)};
    if (source != NULL && wish->from == NULL) {
        camera->orthographic = source->orthographic != 0;
        camera->extent_y = camera->orthographic ? (double)source->extent_y : tan(0.5 * (double)source->extent_y);
    }
    if (wish->field_of_view > 0.0) {
        camera->orthographic = false;
        camera->extent_y = tan(wish->field_of_view * half_degree);
    }
    choose_size(wish, source != NULL && wish->from == NULL && source->aspect > 0.0f ? (double)source->aspect : 4.0 / 3.0, width, height);
    const double aspect = (double)*width / (double)*height;
    camera->extent_x = camera->extent_y * aspect;
    if (wish->from != NULL) {
        camera->position = relative(scene, wish->from);
    } else if (source != NULL) {
        camera->position = relative(scene, source->position);
        camera->right = from_floats(source->right);
        camera->up = from_floats(source->up);
        camera->forward = from_floats(source->forward);
    } else {
        frame_all(scene, camera, aspect);
    }
    if (wish->from == NULL && wish->to == NULL)
        return KILN_OK;
    const struct kiln_dvec3 target = wish->to != NULL ? relative(scene, wish->to) : dvec3(0.0, 0.0, 0.0);
    const struct kiln_dvec3 way = dvec3_sub(target, camera->position);
    if (!(dvec3_length(way) > 0.0))
        return kiln_fail(error, KILN_USAGE, "the eye and its target are the same place: give --from and --to that differ");
    look(camera, unit(way));
    return KILN_OK;
}
