#include "coordinator/run/output_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

static const char MARK[] = ".kiln.unfinished";

enum { OWNER_SIZE = 64, LOCK_TRIES = 3, WALK_DESCRIPTORS = 16 };

struct kiln_output_folder {
    char directory[KILN_PATH_SIZE];
    struct kiln_lock *lock;
    bool made;   /* by this command */
    bool marked; /* so is the mark its own */
};

/* ---- whose it is ---- */

/* Reads the mark: "" where there is none. */
static int read_mark(const char *directory, char owner[OWNER_SIZE], struct kiln_error *error)
{
    char *text = NULL;
    size_t size = 0;
    struct kiln_error unread = {{0}};
    owner[0] = '\0';
    const int status = kiln_read_file_below(directory, MARK, OWNER_SIZE - 1, &text, &size, &unread);
    if (status == KILN_OK)
        (void)snprintf(owner, OWNER_SIZE, "%.*s", (int)strcspn(text, "\n"), text);
    kiln_free(&text);
    return status == KILN_OK || status == KILN_NO_INPUT ? KILN_OK : kiln_fail(error, status, "%s", unread.message);
}

/* Whether the name is that of a lock (lock.h), of the mark, or of the mark's temporary file. */
static bool is_of_this_room(const char *name)
{
    return strncmp(name, ".kiln.lock", strlen(".kiln.lock")) == 0 || strcmp(name, MARK) == 0 ||
           strcmp(name, "..kiln.unfinished.part") == 0;
}

static int find_others(const char *directory, bool *has_others, struct kiln_error *error)
{
    *has_others = false;
    DIR *list = opendir(directory);
    if (list == NULL)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot use %.500s", directory);
    for (const struct dirent *entry; (entry = readdir(list)) != NULL;)
        *has_others = *has_others || (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0 &&
                                      !is_of_this_room(entry->d_name));
    (void)closedir(list);
    return KILN_OK;
}

/* nftw callback: removes a temporary file. One that cannot be removed does no harm until the same file is written
 * again. */
static int remove_temporary(const char *path, const struct stat *found, int type, struct FTW *walk)
{
    static const char ending[] = ".part";
    const char *name = path + walk->base;
    const size_t length = strlen(name);
    (void)found;
    if (type == FTW_F && name[0] == '.' && length > sizeof ending &&
        strcmp(name + length - (sizeof ending - 1), ending) == 0)
        (void)unlink(path);
    return 0;
}

static int refuse(const struct kiln_output_folder_params *params, const char *owner, struct kiln_error *error)
{
    if (owner[0] != '\0')
        return kiln_fail(error, KILN_USAGE,
                         "%.500s has files of '%s', which has not ended: give '%s' another folder with -o",
                         params->directory, owner, params->owner);
    return kiln_fail(error, KILN_USAGE,
                     "%.500s has other files in it: give a folder with -o that is new, is empty, or has what '%s' has "
                     "written before",
                     params->directory, params->owner);
}

static int mark(const struct kiln_output_folder_params *params, struct kiln_error *error)
{
    char owner[OWNER_SIZE], text[OWNER_SIZE + 1];
    bool has_others = false;
    int status;
    KILN_TRY(read_mark(params->directory, owner, error));
    if (strcmp(owner, params->owner) == 0) {
        (void)nftw(params->directory, remove_temporary, WALK_DESCRIPTORS, FTW_PHYS);
        return KILN_OK;
    }
    KILN_TRY(find_others(params->directory, &has_others, error));
    if (has_others && (owner[0] != '\0' || !params->has_results(params->directory, params->context)))
        return refuse(params, owner, error);
end:
    (void)snprintf(text, sizeof text, "%s\n", params->owner);
    return status == KILN_OK ? kiln_publish_bytes_below(params->directory, MARK, text, strlen(text), error) : status;
}

/* ---- begin and end ---- */

/* Makes and locks the folder. Another command that was refused may remove the folder that it had made; then it is made
 * again. */
static int make_and_lock(struct kiln_output_folder *f, const struct kiln_output_folder_params *params,
                         struct kiln_error *error)
{
    struct stat there;
    f->made = stat(f->directory, &there) != 0;
    int status = kiln_make_directories(f->directory, error);
    if (status != KILN_OK || params->kind == KILN_FOLDER_SHARED)
        return status;
    status = kiln_lock_take(&f->lock, f->directory, params->no_locks, error);
    for (int i = 0; i < LOCK_TRIES && status == KILN_NO_INPUT; i++) {
        status = kiln_make_directories(f->directory, error);
        if (status == KILN_OK)
            status = kiln_lock_take(&f->lock, f->directory, params->no_locks, error);
    }
    return status;
}

static int unmark(const char *directory, struct kiln_error *error)
{
    return kiln_unlink_below(directory, MARK) == 0 || errno == ENOENT
               ? KILN_OK
               : kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%.500s/%s' cannot be removed", directory, MARK);
}

int kiln_output_folder_begin(struct kiln_output_folder **folder, const struct kiln_output_folder_params *params,
                             struct kiln_error *error)
{
    struct kiln_output_folder *f = NULL;
    *folder = NULL;
    int status = kiln_allocate(&f, 1, sizeof *f, "an output folder", error);
    if (status != KILN_OK)
        return status;
    const int length = snprintf(f->directory, sizeof f->directory, "%s", params->directory);
    if (length < 0 || length >= KILN_PATH_SIZE)
        status = kiln_fail(error, KILN_CANNOT_CREATE, "the path '%.200s...' is longer than %d bytes", params->directory,
                           KILN_PATH_SIZE - 1);
    if (status == KILN_OK)
        status = make_and_lock(f, params, error);
    if (status == KILN_OK && params->kind == KILN_FOLDER_OWNED)
        f->marked = (status = mark(params, error)) == KILN_OK;
    else if (status == KILN_OK && params->kind == KILN_FOLDER_LOCKED)
        status = unmark(params->directory, error);
    *folder = f;
    if (status != KILN_OK)
        kiln_output_folder_end(folder, false);
    return status;
}

void kiln_output_folder_end(struct kiln_output_folder **folder, bool finished)
{
    struct kiln_output_folder *f = *folder;
    if (f == NULL)
        return;
    bool has_others = true;
    if (f->marked && (finished || (find_others(f->directory, &has_others, NULL) == KILN_OK && !has_others)))
        (void)kiln_unlink_below(f->directory, MARK);
    kiln_lock_release(&f->lock);
    if (f->made)
        (void)rmdir(f->directory);
    kiln_free(folder);
}

const struct kiln_lock *kiln_output_folder_lock(const struct kiln_output_folder *folder) { return folder->lock; }
