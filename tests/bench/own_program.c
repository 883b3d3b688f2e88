/* A library to preload. Under valgrind /proc/self/exe is valgrind's tool, so that kiln cannot start itself for what
 * runs confined; with this library it starts the program that OWN_PROGRAM names. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>

typedef int spawn(pid_t *, const char *, const posix_spawn_file_actions_t *, const posix_spawnattr_t *, char *const[],
                  char *const[]);

int posix_spawn(pid_t *pid, const char *path, const posix_spawn_file_actions_t *actions,
                const posix_spawnattr_t *attributes, char *const arguments[], char *const environment[])
{
    spawn *next = NULL;
    void *found = dlsym(RTLD_NEXT, "posix_spawn");
    const char *own = getenv("OWN_PROGRAM");
    memcpy(&next, &found, sizeof next);
    return next(pid, own != NULL && strcmp(path, "/proc/self/exe") == 0 ? own : path, actions, attributes, arguments,
                environment);
}
