/* Tests of camera paths: frames against the spline's closed forms, and what a file may not say. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/view/camera_path.h"

#define HEADING "from.x,from.y,from.z,to.x,to.y,to.z"

static void near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.9g is not %.9g within %g", a, b, tolerance);
}

static int read_text(const char *text, struct kiln_camera_path **path, struct kiln_error *error)
{
    char name[] = "/tmp/kiln-path-XXXXXX";
    const int descriptor = mkstemp(name);
    assert_true(descriptor >= 0);
    assert_int_equal(write(descriptor, text, strlen(text)), (int)strlen(text));
    (void)close(descriptor);
    const int status = kiln_camera_path_read(path, name, error);
    (void)unlink(name);
    return status;
}

static struct kiln_camera_path *path_of(const char *text)
{
    struct kiln_camera_path *path = NULL;
    struct kiln_error error = {0};
    if (read_text(text, &path, &error) != KILN_OK)
        fail_msg("%s", error.message);
    return path;
}

/* Frames at key frames are the key frames, to the bit; one frame is the first. */
static void keys(void **state)
{
    (void)state;
    struct kiln_camera_path *path =
        path_of("# a walk\n\"field-of-view\", from.x,from.y,from.z,to.x,to.y,to.z\r\n40,0.1,0.2,0.3,1,2,3\r\n\n"
                "50,0.7,-1e-3,3e2,4,5,6\r\n60.5,0.3,0.6,0.9,7,8,9\r\n45,1.1,1.2,1.3,1,2,4");
    const double from[4][3] = {{0.1, 0.2, 0.3}, {0.7, -1e-3, 3e2}, {0.3, 0.6, 0.9}, {1.1, 1.2, 1.3}},
                 angles[] = {40.0, 50.0, 60.5, 45.0};
    struct kiln_camera_frame frame;
    assert_int_equal(kiln_camera_path_keys(path), 4);
    for (size_t k = 0; k < 4; k++) {
        kiln_camera_path_frame(path, 24 * k, 73, &frame);
        assert_memory_equal(frame.from, from[k], sizeof frame.from);
        assert_true(frame.field_of_view == angles[k]);
    }
    kiln_camera_path_frame(path, 6, 7, &frame);
    assert_memory_equal(frame.from, from[3], sizeof frame.from);
    kiln_camera_path_frame(path, 0, 1, &frame);
    assert_memory_equal(frame.from, from[0], sizeof frame.from);
    kiln_camera_path_destroy(&path);
    path = path_of("time," HEADING "\n0.1,0.1,0.2,0.3,1,0,0\n0.35,7,8,9,1,0,0\n0.83,1.1,1.2,1.3,1,0,0\n");
    for (size_t count = 2; count < 60; count++) {
        kiln_camera_path_frame(path, 0, count, &frame);
        assert_memory_equal(frame.from, from[0], sizeof frame.from);
        kiln_camera_path_frame(path, count - 1, count, &frame);
        assert_memory_equal(frame.from, from[3], sizeof frame.from);
    }
    kiln_camera_path_destroy(&path);
}

/* Two key frames are joined by a line; points on a parabola stay on it between inner ones (Catmull-Rom is exact for
 * quadratics there), also with unequal times for a line. */
static void curves(void **state)
{
    (void)state;
    struct kiln_camera_frame frame;
    struct kiln_camera_path *line = path_of(HEADING "\n0,0,0,1,0,0\n8,4,0,1,0,2\n");
    kiln_camera_path_frame(line, 1, 5, &frame);
    near(frame.from[0], 2.0, 1e-15);
    near(frame.to[2], 0.5, 1e-15);
    assert_true(frame.field_of_view == 0.0);
    kiln_camera_path_destroy(&line);
    struct kiln_camera_path *parabola = path_of(HEADING "\n0,0,0,0,0,-9\n1,1,0,0,0,-9\n2,4,0,0,0,-9\n3,9,0,0,0,-9\n");
    for (size_t i = 10; i <= 20; i++) {
        kiln_camera_path_frame(parabola, i, 31, &frame);
        near(frame.from[0], (double)i / 10.0, 1e-14);
        near(frame.from[1], (double)i / 10.0 * (double)i / 10.0, 1e-13);
    }
    kiln_camera_path_destroy(&parabola);
    struct kiln_camera_path *timed =
        path_of("time," HEADING "\n1,1,0,0,0,0,-9\n2,2,0,0,0,0,-9\n7,7,0,0,0,0,-9\n9,9,0,0,0,0,-9\n");
    for (size_t i = 0; i < 17; i++) {
        kiln_camera_path_frame(timed, i, 17, &frame);
        near(frame.from[0], 1.0 + (double)i / 2.0, 1e-13);
    }
    kiln_camera_path_destroy(&timed);
}

/* A closed path has no corner where it closes; an open one has. */
static void closed(void **state)
{
    (void)state;
    struct kiln_camera_path *path =
        path_of(HEADING "\n1,0,0,0,9,0\n0,0,1,0,9,0\n-1,0,0,0,9,0\n0,0,-1,0,9,0\n1,0,0,0,9,0\n");
    struct kiln_camera_frame first, second, last, before;
    enum { FRAMES = 40001 };
    kiln_camera_path_frame(path, 0, FRAMES, &first);
    kiln_camera_path_frame(path, 1, FRAMES, &second);
    kiln_camera_path_frame(path, FRAMES - 1, FRAMES, &last);
    kiln_camera_path_frame(path, FRAMES - 2, FRAMES, &before);
    for (int axis = 0; axis < 3; axis++)
        near((second.from[axis] - first.from[axis]) * 1e4, (last.from[axis] - before.from[axis]) * 1e4, 1e-3);
    near((second.from[2] - first.from[2]) * 1e4, 1.0, 1e-3); /* (p1 - p3) / 2 */
    kiln_camera_path_destroy(&path);
}

static void refused(void **state)
{
    (void)state;
    static const struct {
        const char *text, *why;
    } cases[] = {{"", "0 key frames"},
                 {HEADING "\n0,0,0,1,0,0\n", "1 key frames"},
                 {"from.x,from.y,to.x\n", "no column 'from.z'"},
                 {HEADING ",from.x\n", "two columns 'from.x'"},
                 {HEADING ",roll\n", ":1: 'roll' is no column"},
                 {"0,0,0,1,0,0\n0,0,1,1,0,0\n", "'0' is no column"},
                 {HEADING "\n0,0,0,1,0,0\n0,0,zero,1,0,0\n", ":3: from.z is 'zero'"},
                 {HEADING "\n0,0,0,1,0,nan\n", "to.z is 'nan'"},
                 {HEADING "\n0,0,0,1,0,1e400\n", "to.z is 1e400"},
                 {HEADING "\n0,0,,1,0,0\n", "from.z is ''"},
                 {HEADING "\n0,0,0,1,0\n", "5 values, and there are 6"},
                 {HEADING "\n0,0,0,1,0,0,7\n", "7 values, and there are 6"},
                 {HEADING "\n1,2,3,1,2,3\n", "same point"},
                 {HEADING ",field-of-view\n0,0,0,1,0,0,180\n", "from 0.001 to 179"},
                 {HEADING ",time\n0,0,0,1,0,0,2\n0,0,0,1,0,0,2\n", ":3: time is 2, not after 2"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct kiln_camera_path *path = NULL;
        struct kiln_error error = {0};
        assert_int_equal(read_text(cases[i].text, &path, &error), KILN_BAD_INPUT);
        if (strstr(error.message, cases[i].why) == NULL)
            fail_msg("'%s' does not say '%s'", error.message, cases[i].why);
        assert_null(path);
    }
    struct kiln_camera_path *path = NULL;
    assert_int_equal(kiln_camera_path_read(&path, "/nowhere/path.csv", NULL), KILN_NO_INPUT);
    assert_null(path);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(keys), cmocka_unit_test(curves), cmocka_unit_test(closed),
                                       cmocka_unit_test(refused)};
    return cmocka_run_group_tests_name("camera_path", tests, NULL, NULL);
}
