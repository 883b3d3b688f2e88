/* Finds files by names that were given on another computer. */
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "coordinator/import/confine.h"

enum { PATH_LENGTH = 1024, STEPS_MOST = 8, SCANS_MOST = 4096, ENTRIES_MOST = 1 << 16 };

/* Finds the entry of a folder that equals `name` if case is ignored; of several, the first in byte order. Only the
 * first ENTRIES_MOST entries are searched. */
static bool find_entry(struct kiln_confine *confine, const char *folder, const char *name, char found[256])
{
    const int descriptor =
        confine->scans++ < SCANS_MOST ? kiln_confine_open(confine, folder[0] != '\0' ? folder : ".", O_DIRECTORY) : -1;
    DIR *listing = descriptor < 0 ? NULL : fdopendir(descriptor);
    found[0] = '\0';
    if (listing == NULL && descriptor >= 0)
        (void)close(descriptor);
    for (size_t i = 0; listing != NULL && i < ENTRIES_MOST; i++) {
        const struct dirent *entry = readdir(listing);
        if (entry == NULL)
            break;
        if (strcasecmp(entry->d_name, name) == 0 && (found[0] == '\0' || strcmp(entry->d_name, found) < 0))
            (void)snprintf(found, 256, "%s", entry->d_name);
    }
    if (listing != NULL)
        (void)closedir(listing);
    return found[0] != '\0';
}

static bool is_step(const char *step) { return strcmp(step, ".") != 0 && strcmp(step, "..") != 0; }

/* Resolves the path below `folder`, whatever the case of its letters. */
static bool resolve(struct kiln_confine *confine, const char *folder, const char *rest, char path[PATH_LENGTH + 1])
{
    char step[256], entry[256];
    (void)snprintf(path, PATH_LENGTH + 1, "%s", folder);
    while (*rest != '\0') {
        const size_t length = strcspn(rest, "/"), used = strlen(path);
        if (length == 0 || length >= sizeof step || used + length + 1 > PATH_LENGTH)
            return false;
        (void)snprintf(step, sizeof step, "%.*s", (int)length, rest);
        rest += length;
        if (!is_step(step) || !find_entry(confine, path, step, entry))
            return false;
        (void)snprintf(path + used, PATH_LENGTH + 1 - used, "%s%s", entry, *rest != '\0' ? "/" : "");
        rest += *rest == '/';
    }
    return path[0] != '\0' && path[strlen(path) - 1] != '/' && !kiln_confine_is_missing(confine, path);
}

/* Returns the last `steps` components of a path. */
static const char *end_of(const char *path, size_t steps)
{
    const char *at = path + strlen(path);
    for (size_t i = 0; at > path; at--)
        if (at[-1] == '/' && ++i == steps)
            break;
    return at;
}

/* Whether a path leaves the folder lexically: it is absolute, or has a component "..". */
static bool leads_out(const char *path)
{
    if (path[0] == '/')
        return true;
    for (const char *at = path; *at != '\0'; at += strcspn(at, "/"), at += *at == '/')
        if (strncmp(at, "..", 2) == 0 && (at[2] == '/' || at[2] == '\0'))
            return true;
    return false;
}

enum kiln_found kiln_confine_find(struct kiln_confine *confine, const char *folder, const char *name,
                                  char path[PATH_LENGTH + 1])
{
    char plain[PATH_LENGTH + 1], tried[2 * PATH_LENGTH + 1];
    if (snprintf(path, PATH_LENGTH + 1, "%s%s", folder, name) > PATH_LENGTH) {
        path[0] = '\0';
        return KILN_FOUND_NOT;
    }
    if (name[0] != '\0' && !leads_out(name) && !kiln_confine_is_missing(confine, path))
        return KILN_FOUND_AS_NAMED;
    (void)snprintf(plain, sizeof plain, "%s", name);
    for (char *c = plain; *c != '\0'; c++)
        *c = *c == '\\' ? '/' : *c;
    (void)snprintf(tried, sizeof tried, "%s%s", folder, plain);
    if (strcmp(tried, path) != 0 && !leads_out(plain) && !kiln_confine_is_missing(confine, tried)) {
        (void)snprintf(path, PATH_LENGTH + 1, "%.1024s", tried);
        return KILN_FOUND_AS_NAMED;
    }
    for (size_t steps = STEPS_MOST; steps > 0; steps--) {
        const char *end = end_of(plain, steps);
        if ((steps == STEPS_MOST || end != end_of(plain, steps + 1)) && resolve(confine, folder, end, tried)) {
            (void)snprintf(path, PATH_LENGTH + 1, "%.1024s", tried);
            return KILN_FOUND_OTHERWISE;
        }
    }
    return KILN_FOUND_NOT;
}
