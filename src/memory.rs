//! How the command takes and gives back memory. It is not in the library, whose users choose for themselves.
//!
//! A sample is made of images of a megabyte, made and dropped again and again. The allocator of glibc gives such memory back each
//! time, and the kernel clears it anew: up to a third of the time. It need not, if it is told so.

#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod kept {
    /// Allocations up to this size are cut from memory that is kept, bytes: the largest that glibc takes.
    const LARGEST: libc::c_int = 32 << 20;
    /// So much of it stays with a thread although it is free, bytes.
    const FREE: libc::c_int = 256 << 20;

    /// Keeps freed memory for what is allocated next. To be called before there are other threads.
    pub fn keep_freed() {
        #[allow(unsafe_code, reason = "glibc has no other way to be told")]
        // SAFETY: `mallopt` takes two numbers and has no preconditions but that no other thread allocates meanwhile. One that it
        // does not know it refuses, and all stays as it was.
        unsafe {
            libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST);
            libc::mallopt(libc::M_TRIM_THRESHOLD, FREE);
        }
    }
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
mod kept {
    #[global_allocator]
    static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

    /// This allocator does so of its own accord.
    pub fn keep_freed() {}
}

pub use kept::keep_freed;
