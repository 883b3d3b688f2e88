/* The pictures that kiln view is to draw: one; one for each of several cameras; or the frames of a path. Private to
 * coordinator/cli. Nothing here is collective. */
#ifndef KILN_COORDINATOR_CLI_VIEW_SHOTS_H
#define KILN_COORDINATOR_CLI_VIEW_SHOTS_H

#include "coordinator/files/publish.h"
#include "coordinator/job/job.h"
#include "coordinator/view/camera_path.h"
#include "coordinator/view/view.h"

enum kiln_shots_kind { KILN_SHOTS_ONE, KILN_SHOTS_CAMERAS, KILN_SHOTS_PATH };

struct kiln_shots {
    enum kiln_shots_kind kind;
    size_t count;
    struct kiln_view_wish *wishes;    /* owned */
    struct kiln_camera_frame *frames; /* eye and target that the wishes point to; owned */
    bool numbered;                    /* the cameras' names alone would not tell their files apart */
    const char *output;               /* path of the picture, or what theirs are made from; borrowed */
};

/* Makes the list that the job asks for. The job and the scene must outlive it. Release with kiln_shots_destroy, also
 * after a failure. KILN_USAGE for an unknown camera and for options that contradict each other; the statuses of
 * kiln_camera_path_read. */
int kiln_shots_make(const struct kiln_job *job, const struct kiln_scene *scene, const char *output,
                    struct kiln_shots *shots, struct kiln_error *error);
void kiln_shots_destroy(struct kiln_shots *shots);

/* The path of picture `index`. Of several it is NAME-CAMERA.png or NAME-0001.png: characters of a camera's name but
 * letters, digits, '.', '-' and '_' become '_', and where two would have the same file, all have their number in the
 * list, too: NAME-CAMERA-1.png. KILN_USAGE if it is too long. */
int kiln_shots_path(const struct kiln_shots *shots, const struct kiln_scene *scene, size_t index,
                    char path[KILN_PATH_SIZE], struct kiln_error *error);

#endif
