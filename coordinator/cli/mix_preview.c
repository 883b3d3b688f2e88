#include "coordinator/cli/mix_preview.h"

#include <string.h>

#include "coordinator/files/publish.h"
#include "coordinator/job/options.h"
#include "coordinator/view/view.h"
#include "worker/backend/backend.h"
#include "worker/light/lights.h"

/* Scene to draw, and its backend. */
struct stage {
    struct kiln_scene *scene;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
};

/* As the bake took its materials. */
static enum kiln_gloss_mode mode_of(const json_t *run)
{
    const char *const *names = kiln_option_find_for("materials", KILN_FOR_VIEW)->choices;
    const char *baked = json_string_value(json_object_get(json_object_get(run, "materials"), "mode"));
    for (int i = 0; baked != NULL && names[i] != NULL; i++)
        if (strcmp(baked, names[i]) == 0)
            return (enum kiln_gloss_mode)i;
    return KILN_GLOSS_MODE_DIFFUSE;
}

static int set_up(struct stage *s, const char *directory, const struct kiln_job *job, const json_t *run,
                  struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int status;
    KILN_TRY(kiln_path_join(path, directory, "scene.kscene", error));
    KILN_TRY(kiln_scene_open(&s->scene, path, error));
    KILN_TRY(kiln_scene_take_gloss(s->scene, mode_of(run), error));
    KILN_TRY(kiln_geometry_create(&s->geometry, s->scene, error));
    kiln_geometry_make_all_hittable(s->geometry);
    KILN_TRY(kiln_lights_create(&s->lights, s->scene, s->geometry, error));
    const struct kiln_backend_params params = {
        .scene = s->scene, .geometry = s->geometry, .lights = s->lights, .threads = job->machine.threads};
    KILN_TRY(kiln_backend_create(&s->backend, "embree", &params, error));
end:
    return status;
}

static int draw(const struct stage *s, const char *directory, json_t *run, struct kiln_error *error)
{
    enum { PIXELS = 480 * 360 };
    const struct kiln_view_source source = {
        .directory = directory, .scene = s->scene, .geometry = s->geometry, .lights = s->lights, .backend = s->backend};
    struct kiln_view_wish wish = {.most_pixels = PIXELS};
    struct kiln_kept_picture kept;
    const bool keeps = kiln_picture_keep(json_object_get(run, "preview"), &kept);
    const struct kiln_look look = keeps ? kept.look : (struct kiln_look){.curve = KILN_TONE_FILMIC};
    struct kiln_picture picture = {0};
    if (keeps)
        kiln_picture_keep_place(&kept, &wish);
    int status;
    KILN_TRY(kiln_picture_make(&source, &wish, 2, &look, &picture, error));
    if (wish.from != NULL)
        picture.viewpoint.kind = kept.inside ? KILN_VIEW_INSIDE : KILN_VIEW_OUTSIDE;
    KILN_TRY(kiln_picture_write(directory, "preview.png", &picture, &look, error));
    (void)json_object_set_new(run, "preview", kiln_picture_json(&picture, &look));
end:
    kiln_image_destroy(&picture.image);
    return status;
}

int kiln_mix_preview(const char *directory, const struct kiln_job *job, json_t *run, struct kiln_error *error)
{
    struct stage s = {NULL, NULL, NULL, NULL};
    int status = set_up(&s, directory, job, run, error);
    if (status == KILN_OK)
        status = draw(&s, directory, run, error);
    kiln_backend_destroy(&s.backend);
    kiln_lights_destroy(&s.lights);
    kiln_geometry_destroy(&s.geometry);
    kiln_scene_close(&s.scene);
    return status;
}
