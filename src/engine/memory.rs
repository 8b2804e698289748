//! How this process gets its memory from the system.

/// Blocks that are not larger come from the heap instead of the system. By itself the allocator goes up
/// to this size as such blocks are freed, the largest that it knows.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGEST_OF_HEAP: i32 = 32 << 20;

/// The heap grows by so much once, and keeps as much when it is freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const STEP: i32 = 64 << 20;

/// By how much the allocator lets heaps grow by itself.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const USUAL_STEP: i32 = 128 << 10;

/// Lets the heap of the main thread go on in large pages, if the system has them. Call it before a graph
/// is made.
///
/// A graph of ten thousand nodes is 30 MB in small pieces, and taking them from the system page by page
/// was a quarter of the time of a run that has nothing to do.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn prefer_large_pages() {
    const LARGE_PAGE: usize = 2 << 20;
    // SAFETY: calls into the allocator and the system; the advice is about addresses between a block of
    // ours and the end of the heap, and changes nothing of what is there.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST_OF_HEAP);
        libc::mallopt(libc::M_TRIM_THRESHOLD, STEP);
        libc::mallopt(libc::M_TOP_PAD, STEP);
        // More than the heap has left, so that it grows.
        let block = libc::malloc(1 << 20);
        let start = block.addr().next_multiple_of(LARGE_PAGE);
        let end = libc::sbrk(0).addr();
        if let Some(length) = end.checked_sub(start).filter(|_| !block.is_null()) {
            libc::madvise(block.with_addr(start), length, libc::MADV_HUGEPAGE);
        }
        // The heaps of other threads need no such room.
        libc::mallopt(libc::M_TOP_PAD, USUAL_STEP);
        libc::free(block);
    }
}

/// Other systems do as they like.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn prefer_large_pages() {}
